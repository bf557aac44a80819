"""What of the machine a test has to itself: a terminal, a disk."""
