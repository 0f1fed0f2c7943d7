"""The studio: a local page on which a flight is made by hand.

Words that this package shares:

view
    The state that the page shows, all of one instant: the problem, its newest result, the map.
result
    A plan, or a jump, with all that the page shows of it (:class:`~floatplan.studio.tasks.ShownPlan`); it is settled
    where the thorough search and the proof are finished, and not where it comes from the quick search.
number
    Problems of a session are counted; a result bears the number of its problem, so that late ones are recognised.
task
    Work that is sent to one of the two planning processes.
edit
    A function from a problem to the changed problem.
segment
    0 is the base, i + 1 what joint i moves, as in :mod:`floatplan.view`.
"""
