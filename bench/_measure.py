"""Measuring tools of several benches. Not a bench itself."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterable


def seconds(work: Callable[[], object]) -> float:
    """Return the time that a call takes."""
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def product_rate(n: int = 256, repeats: int = 200) -> float:
    """Return the rate of float32 matrix products of (n, n), in operations per second."""
    import torch

    a, b, out = torch.randn(n, n), torch.randn(n, n), torch.empty(n, n)

    def multiply() -> None:
        for _ in range(repeats):
            torch.mm(a, b, out=out)

    return 2 * n**3 * repeats / seconds(multiply)


def spread(values: list[float]) -> dict[str, float]:
    """Return median, minimum and maximum of some ratios."""
    return {
        "median": round(statistics.median(values), 3),
        "min": round(min(values), 3),
        "max": round(max(values), 3),
    }


def tabulated(
    names: Iterable[str], measure: Callable[[str], dict[str, list[float]]]
) -> dict[str, float]:
    """Measure each task, print its ratios as a table, and return the medians.

    Args:
        names: Names of tasks.
        measure: Returns the ratios of a task, by figure.
    """
    figures = {}
    print(f"{'task':16} {'figure':18} median  quartiles")
    for name in names:
        for figure, values in measure(name).items():
            low, median, high = statistics.quantiles(values, n=4)
            figures[f"{name}.{figure}"] = round(median, 3)
            print(f"{name:16} {figure:18} {median:6.2f}  {low:.2f} to {high:.2f}", flush=True)
    return figures
