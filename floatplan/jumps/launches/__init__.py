"""What a search for the stance beside a plan comes to, and the search beside a plan in space."""
