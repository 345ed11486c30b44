"""Which fitness has the darkest and the brightest color, so that a few outliers don't leave all others in one color."""

from __future__ import annotations

from pga_me_ros.arrays import Float64Array

OUTLYING = 3.0
"""Interquartile ranges beyond the quartiles from where on a value counts as an outlier (Tukey's outer fences)."""

SHARE = 0.02
"""Share of the values that may lie beyond an end of the scale; one always may."""


def color_range(values: Float64Array) -> tuple[float, float]:
    """Return the values of the darkest and the brightest color.

    They are the lowest and the highest value. Only if those are outliers, and at most `SHARE` of all, the scale ends
    before them, and they have the color of its end. The same rule is in `explorer/web/colors.js`.

    Args:
        values: (n,) finite numbers.

    Returns:
        Low and high; 0 and 1 if there are no values.
    """
    if not len(values):
        return 0.0, 1.0
    ordered: list[float] = sorted(values.tolist())
    last = len(ordered) - 1
    low, high = ordered[0], ordered[-1]
    first, third = ordered[last // 4], ordered[last - last // 4]
    spread = OUTLYING * (third - first)
    beyond = max(1, int(SHARE * len(ordered)))
    if spread > 0 and last > 2 * beyond:
        low = max(low, min(ordered[beyond], first - spread))
        high = min(high, max(ordered[last - beyond], third + spread))
    return low, high
