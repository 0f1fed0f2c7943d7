"""What a search for a stance that meets a plan comes to, and the search in space."""
