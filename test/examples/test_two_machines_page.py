"""The commands of docs/two_machines.md, as far as one machine can run them; `make two-hosts` has a network."""

from __future__ import annotations

import re
from pathlib import Path

from commands import TINY, Shell, blocks
from domain_coordinator import domain_id


def test_an_evaluator_of_the_page_joins_the_run_of_the_page(tmp_path: Path) -> None:
    environment, run, evaluators = blocks("two_machines.md")
    exports = [line for line in environment.splitlines() if line.startswith("export")]
    assert len(exports) == 2
    with domain_id() as domain:
        exports[0] = re.sub(r"=\d+\b", f"={domain}", exports[0])
        shell = Shell(domain, tmp_path)
        here = "; ".join(line.partition("#")[0].strip() for line in exports)

        def as_module(command: str) -> str:
            return re.sub(r"ros2 run pga_me_ros (\w+)", r"python -m pga_me_ros.nodes.\1", command)

        loop = evaluators.replace("$(nproc)", "1").strip()
        with shell.started(f"{here}; {as_module(loop)}"):
            # With one evaluator of its own, the run begins only when another has joined.
            more = f"{TINY} -p min_evaluators:=2 -p run_dir:=run"
            output = shell.run(f"{here}; {as_module(run).strip()} {more}")
    assert "evaluations 30/30" in output
