"""What is answered: plans, as motions and as files."""
