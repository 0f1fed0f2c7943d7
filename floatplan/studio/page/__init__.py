"""The page: what the session holds, drawn by viser, and what a hand does to it."""
