"""Is it true? Certificate and replay, from a plan record and a robot alone."""
