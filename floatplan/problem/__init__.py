"""What is asked: problems, their files and options."""
