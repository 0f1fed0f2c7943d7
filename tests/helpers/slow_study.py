"""A study in small chunks with a pause after each, for processes that are to be killed in the middle."""

from __future__ import annotations

import time
from multiprocessing.context import ForkServerProcess
from pathlib import Path

import floatplan as fp
from floatplan.pool import get_ready
from floatplan.studies import driver
from floatplan.studies.study import planned_study

ROWS, PAUSE = 4, 0.05  # of a chunk; [s] after it


def run(path: str, folder: str, shard: str = "") -> None:
    """Run a study slowly, in this process, or a shard of it."""
    driver.FIRST_TOGETHER = driver.MOST_IN_CHUNK = ROWS
    if shard:
        engine = driver.started("processes", 1, None)
        planned_study(Path(path), Path(folder), False, engine, lambda _: time.sleep(PAUSE), shard)
    else:
        fp.study(path, folder=folder, jobs=1, progress=lambda _: time.sleep(PAUSE))


def started(path: str, folder: str, shard: str = "") -> ForkServerProcess:
    """Start a process that does so, with the package loaded already."""
    process = get_ready("floatplan.studies.study").Process(target=run, args=(path, folder, shard))
    process.start()
    return process
