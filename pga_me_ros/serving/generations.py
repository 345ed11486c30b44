"""What a run had achieved after each of its generations, for the service list_generations."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime

import numpy as np
from builtin_interfaces.msg import Time
from pga_me_msgs.srv import ListGenerations

from pga_me_ros.core.archive.corrected import CorrectedMetrics
from pga_me_ros.core.archive.metrics import PER_OPERATOR
from pga_me_ros.core.operators import Operator
from pga_me_ros.core.storage.repertoire import Repertoire
from pga_me_ros.errors import RequestError
from pga_me_ros.ros.convert import flat, metrics_to_msg

MOST = 1000
"""Most generations in one answer."""


def list_generations(
    file: Repertoire,
    cells: int,
    corrected: Mapping[int, CorrectedMetrics],
    request: ListGenerations.Request,
    response: ListGenerations.Response,
) -> None:
    """Fill a response with the generations that a request asks for.

    Args:
        file: The repertoire file; only the rows that are asked for are read.
        cells: Number of cells of its archive.
        corrected: Measures by re-evaluations, by generation.
        request: Asks for generations.
        response: Gets everything but the total.

    Raises:
        RequestError: The request is invalid.
        StorageError: A row of the file is damaged or missing.
    """
    if request.first < 0 or not 1 <= request.limit <= MOST:
        raise RequestError(
            f"first is {request.first} and limit {request.limit}; expected first from 0 on and limit from 1 to {MOST}."
        )
    rows = file.generations(request.first, request.limit)
    for row in rows:
        number = row.metrics.generation
        msg = metrics_to_msg(row.metrics, file.info, cells, corrected.get(number))
        msg.stamp = _time(row.committed)
        response.generations.append(msg)
    response.operators = [operator.label for operator in Operator]
    for name in PER_OPERATOR:
        counts = [getattr(row.metrics, name) for row in rows]
        setattr(response, name, flat(np.array(counts, np.int64), "q"))


def _time(text: str) -> Time:
    """Return a time in ISO 8601 as a message."""
    seconds = datetime.fromisoformat(text).timestamp()
    return Time(sec=int(seconds), nanosec=int(seconds % 1 * 1e9))
