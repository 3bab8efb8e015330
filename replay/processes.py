"""Processes that compute beside each other."""

import multiprocessing
from multiprocessing.context import BaseContext


def importing_once(module: str) -> BaseContext:
    """A context whose processes are forked, where that can be, from one that has imported `module`."""
    if "forkserver" not in multiprocessing.get_all_start_methods():
        return multiprocessing.get_context("spawn")
    context = multiprocessing.get_context("forkserver")
    # Without effect once a process has been started in this way.
    context.set_forkserver_preload([module])
    return context
