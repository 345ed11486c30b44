"""Print docs/interface.md: ``python scripts/interface_docs.py > docs/interface.md``."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from rclpy.qos import DurabilityPolicy, QoSProfile

from pga_me_ros.ros import names, qos

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "pga_me_ros"
DEFINITIONS = ROOT / "msg_defs"
OFFERS = {"create_publisher": "topic", "serve": "service", "create_service": "service"}

STANDARD = {
    "Clock": "rosgraph_msgs",
    "DiagnosticArray": "diagnostic_msgs",
    "Float64MultiArray": "std_msgs",
    "Image": "sensor_msgs",
    "Imu": "sensor_msgs",
    "JointState": "sensor_msgs",
    "OccupancyGrid": "nav_msgs",
    "Odometry": "nav_msgs",
    "SetBool": "std_srvs",
    "String": "std_msgs",
    "TFMessage": "tf2_msgs",
    "Trigger": "std_srvs",
}
"""Packages of the types that other packages define."""

DRAWN = {"HEATMAP": "Image", "GRID": "OccupancyGrid"}
"""Types of the topics that archive_pictures.py creates in a loop."""

PAGE = """\
# Interface: topics, services and types

<!-- Made by scripts/interface_docs.py from msg_defs, ros/names.py, ros/qos.py and the nodes; edit those. -->

Names are relative unless they begin with `/`; `~` is the name of the node. All topics are reliable. "Latched" topics
are transient local: a late subscriber gets the newest message. Services are reliable, too; those that robots ask,
`repertoire/…` and `adapt/…`, hold 100 requests, the others 10, as is ROS 2's default.

## Topics

| topic | type | quality of service | published in |
|---|---|---|---|
{topics}
## Services

| service | type | served in |
|---|---|---|
{services}
## Messages

{messages}
## Service types

{service_types}"""


@dataclass(frozen=True, order=True)
class Offer:
    """A topic that is published or a service that is served."""

    name: str
    kind: str
    type_name: str
    quality: str
    file: str


def offers() -> list[Offer]:
    """Return what the nodes offer according to the calls in their source code, sorted."""
    found = set(_drawn())
    # The mapping file names this topic; that is the name in the files that come with the package.
    controller = PACKAGE / "nodes" / "controller.py"
    found.add(_made("COMMANDS", "topic", "Float64MultiArray", "COMMANDS", controller))
    for path in sorted(PACKAGE.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
                found.update(_offer(node, path))
    return sorted(found)


def _offer(call: ast.Call, path: Path) -> Iterator[Offer]:
    kind = OFFERS.get(getattr(call.func, "attr", ""))
    if kind is None or len(call.args) < 2 or not ast.unparse(call.args[1]).startswith("names."):
        return
    type_name, name = ast.unparse(call.args[0]).removesuffix("Msg"), ast.unparse(call.args[1])
    quality = ast.unparse(call.args[2]) if kind == "topic" else ""
    yield _made(name.removeprefix("names."), kind, type_name, quality.removeprefix("qos."), path)


def _drawn() -> Iterator[Offer]:
    path = PACKAGE / "serving" / "archive_pictures.py"
    for constant, type_name in DRAWN.items():
        if hasattr(names, constant):
            yield _made(constant, "topic", type_name, "LATCHED", path)


def _made(constant: str, kind: str, type_name: str, quality: str, path: Path) -> Offer:
    words = _quality(getattr(qos, quality)) if quality else ""
    return Offer(getattr(names, constant), kind, type_name, words, str(path.relative_to(ROOT)))


def _quality(profile: QoSProfile) -> str:
    latched = ", latched" if profile.durability is DurabilityPolicy.TRANSIENT_LOCAL else ""
    return f"depth {profile.depth}{latched}"


def _type_link(type_name: str) -> str:
    if type_name in STANDARD:
        return f"{STANDARD[type_name]}/{type_name}"
    return f"[{type_name}](#{type_name.lower()})"


def _file_link(file: str) -> str:
    return f"[`{file}`](../{file})"


def _topic_rows(found: list[Offer]) -> str:
    return "".join(
        f"| `{o.name}` | {_type_link(o.type_name)} | {o.quality} | {_file_link(o.file)} |\n"
        for o in found
        if o.kind == "topic"
    )


def _service_rows(found: list[Offer]) -> str:
    return "".join(
        f"| `{o.name}` | {_type_link(o.type_name)} | {_file_link(o.file)} |\n"
        for o in found
        if o.kind == "service"
    )


def _definition(path: Path) -> str:
    """Return a .msg or .srv file in Markdown: the comment at its top, and a table of its fields.

    A comment right above a field explains it; one followed by an empty line is about everything below it.
    """
    about, rows, comment = [], [], []
    part = "request" if path.suffix == ".srv" else ""
    for line in [*path.read_text().splitlines(), ""]:
        if line.startswith("#"):
            comment.append(line[1:].strip())
        elif line == "---":
            part = "response"
        elif line:
            kind, _, name = line.partition(" ")
            rows.append([part, f"`{name}`", f"`{kind}`", " ".join(comment)])
            comment = []
        elif comment:
            if about:
                rows.append(["", "", "", " ".join(comment)])
            about, comment = about or comment, []
    columns = slice(0 if part else 1, None)
    head = ["part", "field", "type", "meaning"][columns]
    table = [_row(head), "|" + "---|" * len(head), *(_row(row[columns]) for row in rows)]
    return "\n".join([f"### {path.stem}", "", *about, "", *table, ""])


def _row(cells: list[str]) -> str:
    return f"| {' | '.join(cells)} |"


def page() -> str:
    """Return the page in Markdown."""
    found = offers()
    return PAGE.format(
        topics=_topic_rows(found),
        services=_service_rows(found),
        messages="\n".join(map(_definition, sorted((DEFINITIONS / "msg").glob("*.msg")))),
        service_types="\n".join(map(_definition, sorted((DEFINITIONS / "srv").glob("*.srv")))),
    )


if __name__ == "__main__":
    print(page(), end="")
