"""How much one call simulates at most."""

MOST_FLIGHTS = 10_000  # [-] robots of one call
MOST_PERIODS = 100_000  # [-] of control in one run
BUDGET = 60.0  # [s] after which no run of a replay begins, unless another is requested
