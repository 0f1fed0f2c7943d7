"""A study in small chunks, for processes that are to be killed in the middle: they wait for that after some chunks."""

from __future__ import annotations

import time
from multiprocessing.context import ForkServerProcess
from pathlib import Path

import floatplan as fp
from floatplan.pool import start_server
from floatplan.studies import driver
from floatplan.studies.study import planned_study

ROWS = 4  # of a chunk
FOR_EVER = 3600.0  # [s]


def run(path: str, folder: str, chunks: int, shard: str = "") -> None:
    """Run a study in this process, or a shard of it, until there are so many chunks."""
    driver.FIRST_CHUNK = driver.MOST_IN_CHUNK = ROWS

    def wait(progress: driver.Progress) -> None:
        if progress.done >= chunks * ROWS:
            time.sleep(FOR_EVER)

    if shard:
        planned_study(Path(path), Path(folder), False, driver.started("processes", 1, None), wait, shard)
    else:
        fp.study(path, folder=folder, jobs=1, progress=wait)


def started(path: str, folder: str, chunks: int, shard: str = "") -> ForkServerProcess:
    """Start a process that does so, with the package loaded already."""
    process = start_server("floatplan.studies.study").Process(target=run, args=(path, folder, chunks, shard))
    process.start()
    return process
