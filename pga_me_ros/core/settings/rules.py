"""What each algorithm makes of the settings: its own defaults, and what it refuses.

Light, and typed by the settings themselves, so that they need nothing of the algorithms: `core.algorithms` has those.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import fields
from typing import Any, ClassVar

from pga_me_ros.core.settings.algorithms import AlgorithmSettings
from pga_me_ros.core.settings.run import ARCHIVE_KINDS
from pga_me_ros.errors import SettingsError

CRITICS = ("critics", "torch")
"""Parts of an algorithm that trains critics."""

GRADIENTS = (*CRITICS, "gradients")
"""Parts of an algorithm whose offspring climb critics."""


class Rules:
    """Rules of one algorithm.

    Attributes:
        parts: Parts that it has, as settings name them (`field.setting`), besides one of its own name.
        fixed: Settings of other algorithms that it leaves no choice for, and why: "... but NAME <reason>".
    """

    parts: ClassVar[tuple[str, ...]] = ()
    fixed: ClassVar[Mapping[str, str]] = {}

    def own_values(self, given: Mapping[str, Any]) -> dict[str, Any]:
        """Return its own value of every setting whose default says so.

        Args:
            given: The settings that were given.
        """
        return {
            "batch_size": 100,
            "random_init": 500,
            "replay_size": 1_000_000,
            "schedule": "alternating",
            "n_evo": 0,
            "n_crit": 300,
            "transition_batch": 256,
            "n_grad": 10,
            "pg_learning_rate": 0.001,
        }

    def check(self, settings: AlgorithmSettings) -> None:
        """Refuse values that do not fit each other.

        Args:
            settings: All settings, each valid by itself.

        Raises:
            SettingsError: Two values do not fit each other.
        """
        self.check_extraction(settings)
        if settings.batch_size < 2:
            raise SettingsError(
                f"batch_size is {settings.batch_size}; {settings.algorithm} needs at least 2 controllers per "
                "generation."
            )
        if settings.pg_learning_rate < 0.0:
            raise SettingsError(
                f"pg_learning_rate is {settings.pg_learning_rate}; expected a value from 0.0 to 10.0, or -1 for the "
                "algorithm's own."
            )

    def check_extraction(self, settings: AlgorithmSettings) -> None:
        """Refuse cells with a depth that nothing looks into, and shares of a batch that leave nothing or are nothing.

        Raises:
            SettingsError: As said.
        """
        if settings.cell_depth > 1 and not settings.extract_share:
            raise SettingsError(
                f"cell_depth is {settings.cell_depth}, but extract_share is 0, so what lies below an elite would never "
                "return; give extract_share, or remove cell_depth."
            )
        places, batch = settings.extracted, settings.batch_size
        if settings.extract_share and not 1 <= places <= batch - 2:
            raise SettingsError(
                f"extract_share is {settings.extract_share}, which is {places} of a batch of {batch} controllers; give "
                "a share that takes one of them at least, and leaves two."
            )

    def uses(self, name: str) -> bool:
        """Whether the algorithm leaves a choice for a setting, given its name."""
        part = _PARTS.get(name, "")
        return name not in self.fixed and part in {"", *ARCHIVE_KINDS, *self.parts}


class _PgaMapElites(Rules):
    parts = (*GRADIENTS, "genetic", "pga_map_elites", "extraction")

    def own_values(self, given: Mapping[str, Any]) -> dict[str, Any]:
        """Half of a batch is made by genetic variation (Table 1)."""
        values = {**super().own_values(given), "schedule": "overlapped"}
        return values | {"n_evo": given.get("batch_size", values["batch_size"]) // 2}

    def check(self, settings: AlgorithmSettings) -> None:
        """Also refuse more GA offspring than a batch has places."""
        super().check(settings)
        if settings.n_evo > settings.batch_size:
            raise SettingsError(
                f"n_evo is {settings.n_evo}, but a batch has batch_size={settings.batch_size} controllers; "
                f"give n_evo a value from 0 to {settings.batch_size}."
            )


class _MapElites(Rules):
    parts = ("genetic", "extraction")
    fixed: ClassVar = {"n_evo": "makes all offspring of a generation by genetic variation"}

    def own_values(self, given: Mapping[str, Any]) -> dict[str, Any]:
        """All of a batch is made by genetic variation."""
        values = super().own_values(given)
        return values | {"n_evo": given.get("batch_size", values["batch_size"])}


class _PgOnly(Rules):
    parts = (*GRADIENTS, "extraction")
    fixed: ClassVar = {"n_evo": "makes no offspring by genetic variation"}

    def own_values(self, given: Mapping[str, Any]) -> dict[str, Any]:
        """Critics train while a generation is evaluated, as in PGA-MAP-Elites."""
        return {**super().own_values(given), "schedule": "overlapped"}


class _Td3(Rules):
    parts = (*CRITICS, "td3", "extraction")
    fixed: ClassVar = {
        "n_evo": "evaluates its actor in every place of a batch",
        "n_crit": "takes one training step per control step of the last generation",
        "critic_start": "trains between generations only",
        "schedule": "trains between generations only",
    }

    def own_values(self, given: Mapping[str, Any]) -> dict[str, Any]:
        """Ten episodes of the actor are a generation."""
        return {**super().own_values(given), "batch_size": 10}

    def check(self, settings: AlgorithmSettings) -> None:
        """Take any batch: it consists of episodes of one actor."""
        self.check_extraction(settings)


class _MapElitesEs(Rules):
    parts = ("map_elites_es",)
    fixed: ClassVar = {
        "n_evo": "makes its offspring by steps of an evolution strategy",
        "start_from": "starts from a single random controller",
        "random_init": "starts from a single random controller",
    }

    def own_values(self, given: Mapping[str, Any]) -> dict[str, Any]:
        """A batch is all samples and the controller that the last step led to; only the newest generation counts."""
        samples = given.get("es_samples", AlgorithmSettings.es_samples)
        own = {"batch_size": 1 + samples, "random_init": 1, "replay_size": 1}
        return {**super().own_values(given), **own}

    def check(self, settings: AlgorithmSettings) -> None:
        """Refuse samples that cannot be mirrored, and a batch that they do not fill."""
        if settings.es_samples % 2:
            raise SettingsError(
                f"es_samples is {settings.es_samples}, but samples come in mirrored pairs; give an even number."
            )
        if settings.batch_size != 1 + settings.es_samples:
            raise SettingsError(
                f"batch_size is {settings.batch_size}, but a generation of {settings.algorithm} has es_samples + 1 = "
                f"{1 + settings.es_samples} controllers; remove batch_size and set es_samples."
            )


class _QdRl(Rules):
    parts = (*GRADIENTS, "qd_rl", "extraction")
    fixed: ClassVar = {
        "n_evo": "makes no offspring by genetic variation",
        "critic_start": "trains between generations only",
        "schedule": "trains between generations only",
    }

    def own_values(self, given: Mapping[str, Any]) -> dict[str, Any]:
        """Four offspring are a generation."""
        return {**super().own_values(given), "batch_size": 4}


class _DcrlMapElites(_PgaMapElites):
    parts = (*GRADIENTS, "genetic", "dcrl_map_elites", "extraction")
    fixed: ClassVar = {
        "greedy_init": "starts its actor at random: no controller has the actor's layers"
    }

    def own_values(self, given: Mapping[str, Any]) -> dict[str, Any]:
        """Values of its authors' program (`configs/algo/dcrl_me.yaml`); a batch of random controllers comes first."""
        b = given.get("batch_size", 256)
        own = {"batch_size": b, "random_init": b, "n_evo": b // 2}
        learning = {"n_crit": 3000, "transition_batch": 100}
        pg = {"n_grad": 150, "pg_learning_rate": 0.005}
        return {**super().own_values(given), **own, **learning, **pg}


RULES: Mapping[str, Rules] = {
    "pga_map_elites": _PgaMapElites(),
    "map_elites": _MapElites(),
    "pg_only": _PgOnly(),
    "td3": _Td3(),
    "map_elites_es": _MapElitesEs(),
    "qd_rl": _QdRl(),
    "dcrl_map_elites": _DcrlMapElites(),
}
"""The rules of every algorithm, by the value of the setting `algorithm`."""


def of_other_archives(archive: str) -> set[str]:
    """Return the names of the settings that an archive of this kind has no use for."""
    return {name for name, part in _PARTS.items() if part in ARCHIVE_KINDS and part != archive}


def useless(names: Iterable[str], algorithm: str, archive: str) -> set[str]:
    """Return those settings, of some names, that a run has no use for.

    Args:
        names: Names of settings.
        algorithm: Value of the setting `algorithm`; one that is unknown uses all.
        archive: Value of the setting `archive`.
    """
    rules, others = RULES.get(algorithm), of_other_archives(archive)
    return {n for n in names if n in others or (rules is not None and not rules.uses(n))}


_PARTS = {f.name: f.metadata["part"] for f in fields(AlgorithmSettings) if f.metadata["part"]}
