"""Asks somebody at the desk, in the terminal, or a file of answers."""

from __future__ import annotations

import sys
from collections import defaultdict, deque
from pathlib import Path

from anytraverse.engine import AnyTraverse
from anytraverse.regular_file import read_regular
from companion.desk.drives.answered_before import nearest_to
from companion.desk.drives.drive import DriveError
from companion.desk.drives.rehearsal import AskedCall, Rehearsal
from companion.pages import wording
from companion.pages.calls import known_thing
from companion.wire.typed_answers import CommandError, read_typed
from companion.wire.words_text import turned

_SEPARATOR = " = "
_LARGEST = 16 << 20
"""Bytes of a file of answers, at most."""
_HELP = """\
  tap drum -1, go                 what it points at is a drum, and never drivable
  gravel: 1; dry grass: 0.3, go   words for the ground here
  go                              all is well here: do not ask about this place again
  same                            where it is offered: what you said of such a thing before
  (an empty line)                 skip: it is asked on the rover
  quit                            end here, and keep what was answered"""


class AnswerFile:
    """Answers by the frame of a call: lines `FRAME = ANSWER`; those of one frame count in their order."""

    def __init__(self, path: Path) -> None:
        """Raises DriveError for a line that is no answer, and OSError."""
        self._answers: defaultdict[str, deque[str]] = defaultdict(deque)
        content = read_regular(path, _LARGEST + 1)
        if len(content) > _LARGEST:
            raise DriveError(f"{path} is larger than {_LARGEST >> 20} MiB: this is no file of answers")
        try:
            text = content.decode("utf-8-sig")  # editors of Windows begin a file with a mark
        except UnicodeDecodeError as error:
            raise DriveError(f"{path} is no text in UTF-8: save it as that") from error
        for number, line in enumerate(text.split("\n"), 1):
            if not line.strip() or line.startswith("#"):
                continue
            frame, separator, answer = line.rpartition(_SEPARATOR)
            try:
                if not separator or not answer.strip():
                    raise CommandError(f"write it as `0412.jpg{_SEPARATOR}gravel: 1, go`")
                read_typed(answer.strip())
            except CommandError as error:
                raise DriveError(f"{path}, line {number}: {error}") from error
            self._answers[frame.strip()].append(answer.strip())

    def ask(self, call: AskedCall, _problem: str) -> str | None:
        """Return the next answer to a call of this frame, None where there is none."""
        waiting = self._answers.get(call.frame)
        return waiting.popleft() if waiting else None

    def of(self, frame: str) -> tuple[str, ...]:
        """Return the answers to calls of a frame, as typed."""
        return tuple(self._answers.get(frame, ()))

    def left(self) -> list[str]:
        """Return the frames whose answers were not asked for."""
        return [frame for frame, waiting in self._answers.items() if waiting]


class Terminal:
    """Prints a call, and reads answers from the keyboard. One that turns a sign must be typed twice."""

    def __init__(self, out: Path, engine: AnyTraverse, found: Rehearsal) -> None:
        """out: where the pictures of calls are. engine: of the drive. found: what it led to so far."""
        self._out = out
        self._engine = engine
        self._found = found
        self._asked = 0
        self._same = ""

    def ask(self, call: AskedCall, problem: str) -> str | None:
        """Ask. An empty line, or the end of input, is None. Raises KeyboardInterrupt for `quit`."""
        if call.id != self._asked:
            self._asked = call.id
            print(f"\nC{call.id} at {call.at:.1f} s, {call.frame}: {wording.reason(call.data)}")
            print(f"  {wording.figures(call.data)}")
            print(f"  {self._out / 'calls' / f'{call.id}-large.jpg'}")
            self._offer(call)
        if problem:
            print(f"  {problem}")
        turning = ""
        while True:
            try:
                line = input("answer (? for help): ").strip()
            except EOFError:
                return None
            if line.lower() == "same":
                line = self._same or line
            if line.lower() in ("?", "help"):  # what a refused answer says to type
                print(_HELP)
            elif line.lower() == "quit":
                raise KeyboardInterrupt
            elif line != turning and (question := self._question(line)):
                turning = line
                print(f"  {question}")
            else:
                return line or None

    def _offer(self, call: AskedCall) -> None:
        """Tell what was said in the scene most like a call's, and offer to say it again."""
        nearest, self._same = nearest_to(call, self._found.calls, self._engine), ""
        if nearest is None:
            return
        print(f"  {nearest['text']}")
        if (known := known_thing(call.data, nearest)) is not None:
            motion = "" if known["motion"] == "none" else f", {known['motion']}"
            self._same = f"tap {known['word']}: {known['weight']:g}{motion}"
            print(f"  same: {known['text']}")

    def _question(self, line: str) -> str:
        memory = self._engine.memory
        try:
            return turned(read_typed(line).operations, memory.preferences, memory.given, memory.matched)
        except CommandError:
            return ""  # whoever applies it says what is wrong


def terminal(out: Path, engine: AnyTraverse, found: Rehearsal) -> Terminal | None:
    """Return the terminal, None where nobody sits at it. Arguments: of `Terminal`."""
    return Terminal(out, engine, found) if sys.stdin.isatty() and sys.stdout.isatty() else None


def answer_lines(calls: list[AskedCall]) -> str:
    """Return what was answered, as a file of answers; what was not stands in it as a comment."""
    lines = ["# Answers to the calls of a drive: `companion rehearse DRIVE --answers THIS` gives them again."]
    for call in calls:
        lines += [f"{call.frame}{_SEPARATOR}{said.line}" for said in call.said if said.taken]
        if not call.by_person:
            lines.append(f"# {call.frame}{_SEPARATOR}     C{call.id}: {wording.reason(call.data)}")
    return "\n".join(lines) + "\n"
