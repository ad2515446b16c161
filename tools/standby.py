"""A run that waits to be started over Zenoh: nothing moves, and nothing is armed, before `call/start`."""

from __future__ import annotations

import time
from dataclasses import replace

from preshape.tools.run_options import RunOptions
from preshape.tools.telemetry_orders import Orders

_NAP_S = 0.01


def await_start(orders: Orders, options: RunOptions) -> RunOptions:
    """Wait until a start or a stop is ordered; return the options with the goal that was given meanwhile, if any."""
    orders.order("waiting")
    while not (orders.ordered("start") or orders.stopped):
        time.sleep(_NAP_S)
    orders.order("waiting", 0)
    task = orders.ordered("until_task")
    return replace(options, until_task=task) if task else options
