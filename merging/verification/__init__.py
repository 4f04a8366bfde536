"""What two maps say for and against a hypothesis, and how exact it is."""
