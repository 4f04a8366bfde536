"""What a merge did, for programs and for people."""
