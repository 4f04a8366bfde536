"""Work on several cores or machines, and its progress."""
