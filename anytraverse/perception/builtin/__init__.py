"""Makes the built-in perceivers, which need no download."""

from __future__ import annotations

from pathlib import Path

from anytraverse.errors import PerceiverError
from anytraverse.perception import NAMED, Perceiver
from anytraverse.perception.runtime import Runtime


def make_builtin(argument: str, runtime: Runtime) -> Perceiver:
    """Make a built-in perceiver. Raises PerceiverError for another argument, or a network that fails to load.

    argument: "": the package's network; FILE.onnx: the user's own; "lexicon": colours alone, no network.
    """
    if argument == "lexicon":
        from anytraverse.perception.builtin.lexicon import Lexicon

        return Lexicon()
    if argument and not argument.endswith(".onnx"):
        raise PerceiverError(
            f'there is no "builtin:{argument}": choose {", ".join(NAMED)} '
            "or builtin:FILE.onnx for a network of your own"
        )
    from anytraverse.perception.builtin.perceiver import SHIPPED, GroundNetwork

    return GroundNetwork(Path(argument).expanduser() if argument else SHIPPED, runtime)
