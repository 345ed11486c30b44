"""Parameters of the recorder."""

from __future__ import annotations

from dataclasses import dataclass

from pga_me_ros.core.settings.field import setting


@dataclass(frozen=True)
class RecorderSettings:
    """What is recorded, and where."""

    bag: str = setting(
        "",
        "Folder of the recording, which must not exist; empty for recording-TIME.",
        path=True,
    )
