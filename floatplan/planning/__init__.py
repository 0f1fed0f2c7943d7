"""From a problem to a plan: the search, what it gives the kernel, and what it makes of the answer.

Words: a *spec* is a problem prepared; a *start* is a motion from which the kernel follows others, by their numbers; an
*attempt* is one call of the kernel, and its result the best motion (``attempts`` of the options count starts); a
*search* makes attempts until enough are solved; a *batch* is one attempt at every one of many problems. *Rows* are
inequalities, at least 0 where they hold, in *blocks* of one topic. A motion *holds* where the goal and all rows do, at
all times; the *nominal* motion has no free coefficients.

Symbols: x, variables of a search, without unit; z, free coefficients of (12); b, its coefficients by powers of seconds;
h, angular momentum, kg m^2/s; s, share of the flight, in [0, 1]. A row has no unit; times its block's ``scale`` it is
in the block's ``unit``.
"""
