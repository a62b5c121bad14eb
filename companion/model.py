"""What is known of the perceiver that runs, for log, status file and operator."""

from __future__ import annotations

from typing import NamedTuple

from anytraverse.perception import Perceiver


class Model(NamedTuple):
    """A perceiver as a person knows it.

    precision, why: the variant of its bundle that runs, and why that one; "" without a bundle.
    int8_idle: the bundle carries int8, and it is not what runs.
    """

    id: str
    precision: str = ""
    why: str = ""
    int8_idle: bool = False

    @classmethod
    def of(cls, perceiver: Perceiver) -> Model:
        """What `perceiver` says of itself."""
        precision = getattr(perceiver, "precision", "")
        manifest = getattr(perceiver, "manifest", None)
        idle = manifest is not None and "int8" in manifest.variants and precision != "int8"
        return cls(perceiver.model_id, precision, getattr(perceiver, "why", ""), idle)

    def __str__(self) -> str:
        return f"{self.id}, {self.precision}: {self.why}" if self.precision else self.id
