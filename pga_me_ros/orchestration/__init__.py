"""The parts of the orchestrator: children, evaluators, the generation loop, progress."""
