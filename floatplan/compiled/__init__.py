"""Many plans at once: plans without inequalities, compiled. What it does not find, or cannot do, the search does."""
