"""What a plan has to do: problems, their files and options."""
