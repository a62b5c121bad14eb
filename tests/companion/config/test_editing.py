"""A program changes the configuration file: comments and all else stay, and it says what was asked."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from companion.config import ConfigError, load_config
from companion.config.checks import ValueCheck, checks_of
from companion.config.editing import Guard, Proposal, guard_of, propose, write
from companion.config.schema import SECTIONS

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

SHIPPED = Path(__file__).parents[3] / "config"
_OPEN_TEXTS = {
    "camera.source": [
        "v4l2:/dev/video0",
        "v4l2:/dev/v4l/by-id/usb-a_b.c-index0",
        "rtsp://10.0.0.7/s",
        "oak:",
    ],
    "perceiver.name": ["builtin", "builtin:lexicon"],
    "link.url": ["udpin:127.0.0.1:14550", "serial:/dev/ttyAMA0:57600"],
    "call.policy": ["report", "shadow"],
}


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """The configuration as shipped."""
    for name in ("companion.toml", "vehicles/rover.toml"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        shutil.copy(SHIPPED / name, tmp_path / name)
    (tmp_path / "companion.toml").chmod(0o640)
    return tmp_path / "companion.toml"


def _values(check: ValueCheck, key: str) -> st.SearchStrategy[Any]:
    """Values that the check of one setting takes."""
    schema = dict(check.schema)
    if key in _OPEN_TEXTS:
        return st.sampled_from(_OPEN_TEXTS[key])
    if "anyOf" in schema:
        schema = dict(schema["anyOf"][0])
    if "enum" in schema:
        return st.sampled_from(schema["enum"])
    if schema["type"] == "boolean":
        return st.booleans()
    if schema["type"] == "array":
        one = schema["items"]
        items = st.sampled_from(one["enum"]) if "enum" in one else st.integers(one["minimum"], one["maximum"])
        return st.lists(items, min_size=schema["minItems"], max_size=schema["maxItems"])
    low: float = schema["minimum"] if "minimum" in schema else schema["exclusiveMinimum"]
    high: float = schema["maximum"]
    if schema["type"] == "integer":
        return st.integers(int(low), int(high))
    broken = st.floats(low, high, exclude_min="exclusiveMinimum" in schema)
    return broken | st.integers(int(low) + 1, int(high)) if low + 1 <= high else broken


@st.composite
def _one_change(draw: st.DrawFn) -> tuple[str, Any]:
    section = draw(st.sampled_from(sorted(SECTIONS)))
    keys = [
        key
        for key, check in checks_of(SECTIONS[section]).items()
        if f"{section}.{key}" in _OPEN_TEXTS or (check.schema.get("type") != "string" and key != "more")
    ]
    if not keys:
        return "words.rock", draw(st.floats(-1, 1))
    key = draw(st.sampled_from(keys))
    return f"{section}.{key}", draw(_values(checks_of(SECTIONS[section])[key], f"{section}.{key}"))


def _leaves(data: Mapping[str, Any], *above: str) -> Iterator[tuple[tuple[str, ...], Any]]:
    for key, value in data.items():
        if isinstance(value, Mapping):
            yield from _leaves(value, *above, key)
        else:
            yield (*above, key), value


def _comments(text: str) -> list[str]:
    return [line for line in text.splitlines() if line.startswith("#")]


@pytest.mark.slow
@given(_one_change(), st.booleans())
@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_any_change_keeps_all_else_and_reads_back_as_asked(
    file: Path, change: tuple[str, Any], crlf: bool
) -> None:
    text = (SHIPPED / "companion.toml").read_text()
    file.write_bytes(text.replace("\n", "\r\n" if crlf else "\n").encode())
    key, value = change
    proposal = propose(file, {key: value})
    before, after = (dict(_leaves(tomllib.loads(one))) for one in (proposal.before, proposal.after))
    path = tuple(key.split(".", 1))
    assert after.pop(path) == value
    before.pop(path, None)
    copied = {one: weight for one, weight in after.items() if one[0] == "words" and one not in before}
    assert {one: after[one] for one in after if one not in copied} == before
    assert bool(copied) is (path[0] == "words")
    headline = f"# [{path[0]}]"
    kept = [line for line in _comments(proposal.before) if line.strip() != headline]
    assert [line for line in _comments(proposal.after) if line.strip() != headline] == kept
    assert ("\r\n" in proposal.after) is crlf
    assert proposal.after.count("\r\n") in (0, proposal.after.count("\n"))
    if not proposal.problems:
        file.write_bytes(proposal.after.encode())
        section, name = path
        config = load_config(file)
        read = config.words[name] if section == "words" else getattr(getattr(config, section), name)
        assert read == (tuple(value) if isinstance(value, list) else value)


@pytest.mark.slow
@given(_one_change())
@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_a_setting_that_is_set_and_removed_again_leaves_the_comments_and_values(
    file: Path, change: tuple[str, Any]
) -> None:
    shutil.copy(SHIPPED / "companion.toml", file)
    key, value = change
    file.write_bytes(propose(file, {key: value}).after.encode())
    removed = propose(file, {key: None})
    left = dict(_leaves(tomllib.loads(removed.after)))
    assert tuple(key.split(".", 1)) not in left


def test_a_new_setting_stands_below_the_comment_that_shows_its_default(file: Path) -> None:
    after = propose(file, {"mount.height": 0.35, "mount.tilt": 12.0, "camera.fps": 30.0}).after.splitlines()
    assert after[after.index("# height = 1.0") + 1] == "height = 0.35"
    assert after[after.index("# fps = 30.0") + 1] == "fps = 30.0"
    assert "[mount]" in after
    assert "# [mount]" not in after


def test_a_word_is_added_to_those_of_the_vehicle_s_file(file: Path) -> None:
    before = load_config(file).words
    file.write_bytes(propose(file, {"words.rock": -1.0}).after.encode())
    assert load_config(file).words == {**before, "rock": -1.0}


@pytest.mark.parametrize(
    ("words", "changes"),
    [
        ("", {"words.grass": None}),
        ("", {"words": {}}),
        ("words.mud = -1.0\n", {"words.mud": None}),
        ("[words]\nmud = -1.0\n", {"words.mud": None}),
        ("words = {mud = -1.0}\n", {"words": {}}),
    ],
)
def test_without_the_last_word_those_of_the_vehicle_s_file_do_not_come_into_force(
    file: Path, words: str, changes: dict[str, Any]
) -> None:
    (file.parent / "vehicles/rover.toml").write_text("[words]\ngrass = 1.0\n")
    file.write_text(f'{words}[vehicle]\nfile = "vehicles/rover.toml"\n')
    assert load_config(file).words
    proposal = propose(file, changes)
    assert proposal.diff
    write(file, proposal)
    assert load_config(file).words == {}
    write(file, propose(file, {"words.rock": -1.0}))
    assert load_config(file).words == {"rock": -1.0}


def test_a_word_that_is_not_there_is_removed_without_a_change(file: Path) -> None:
    file.write_text('[vehicle]\nfile = ""\n')
    assert propose(file, {"words.mud": None}).diff == ""


def test_a_whole_table_of_words_replaces_the_words_and_keeps_the_comments(file: Path) -> None:
    file.write_text('[words]\n# mine\ngrass = 1.0  # the meadow\n"dirt Path" = 1\nbush = -1\n')
    proposal = propose(file, {"words": {"grass": 0.5, "dirt path": 0.8, "rock": -1.0}})
    assert proposal.after == ('[words]\n# mine\ngrass = 0.5  # the meadow\n"dirt Path" = 0.8\nrock = -1.0\n')
    gone = propose(file, {"words": None})
    assert gone.after == "# mine\n"
    assert not gone.problems


@pytest.mark.parametrize(
    ("text", "key", "value", "after"),
    [
        ("", "camera.rate", 5.0, "[camera]\nrate = 5.0\n"),
        ("# a\n", "vocabulary", ["mud"], '# a\n\nvocabulary = ["mud"]\n'),
        ("[camera]\n", "vocabulary", ["mud"], 'vocabulary = ["mud"]\n\n[camera]\n'),
        ("camera.loop = true # x\n", "camera.rate", 5, "camera.loop = true # x\ncamera.rate = 5\n"),
        ("[camera]\nloop = true", "camera.rate", 5, "[camera]\nloop = true\nrate = 5"),
        (
            "[link]\npace = 0.05\n[link.more.a]\nurl = 'x'\n",
            "link.more.a.pace",
            0.05,
            "[link]\npace = 0.05\n[link.more.a]\nurl = 'x'\npace = 0.05\n",
        ),
        (
            "[perceiver]\nproviders = [ # first\n  'CPU', # here\n]\nthreads = 1\n",
            "perceiver.threads",
            2,
            "[perceiver]\nproviders = [ # first\n  'CPU', # here\n]\nthreads = 2\n",
        ),
        (
            "[camera]\n# [mount]\nrate = 1\n",
            "mount.roll",
            1,
            "[camera]\n# [mount]\nrate = 1\n\n[mount]\nroll = 1\n",
        ),
    ],
)
def test_a_setting_is_written_as_its_file_is_written(
    tmp_path: Path, text: str, key: str, value: object, after: str
) -> None:
    file = tmp_path / "companion.toml"
    file.write_text(text)
    assert propose(file, {key: value}).after == after


def test_settings_of_an_inline_table_are_set_and_removed_in_it(tmp_path: Path) -> None:
    file = tmp_path / "companion.toml"
    file.write_text("camera = { loop = true, fps = 5 } # x\n")
    after = propose(file, {"camera.rate": 5, "camera.fps": None}).after
    assert tomllib.loads(after) == {"camera": {"loop": True, "rate": 5}}
    assert after.endswith("# x\n")
    assert after.count("\n") == 1


def test_what_does_not_exist_is_refused_and_changes_nothing(file: Path) -> None:
    for key in (
        "camera.sorce",
        "cam.source",
        "camera",
        "link.more.url",
        "link.more.a.b.url",
        "",
        "vocabulary.x",
    ):
        proposal = propose(file, {key: 1, "camera.rate": 5.0})
        assert proposal.problems, key
        assert (proposal.after, proposal.diff) == (proposal.before, "")
        assert key in proposal.guarded
    assert 'did you mean "source"' in str(propose(file, {"camera.sorce": 1}).problems[0])


@pytest.mark.parametrize("value", [object(), {"a": 1}, float("nan"), [float("inf")], b"x"])
def test_a_value_that_is_none_of_toml_is_a_problem(file: Path, value: object) -> None:
    assert propose(file, {"camera.rate": value}).problems


def test_wrong_values_are_the_problems_that_config_check_tells(file: Path) -> None:
    proposal = propose(file, {"camera.rate": 1000.0, "words.snark": 1.0})
    assert [problem.key for problem in proposal.problems] == ["camera.rate"]
    (problem,) = propose(file, {"words.snark": 1.0}).problems
    assert (problem.key, problem.line) == (
        "words.snark",
        proposal.after.splitlines().index("snark = 1.0") + 1,
    )
    (problem,) = propose(file, {"call.policy": "hold"}).problems
    assert problem.key == "call.policy"
    (problem,) = propose(file, {"roi.left": 0.4, "roi.right": 0.5}).problems
    assert problem.key == "roi"


def test_a_file_that_cannot_be_read_is_an_error(tmp_path: Path) -> None:
    for text in ("[camera\n", "a = 1\na = 2\n"):
        (tmp_path / "companion.toml").write_text(text)
        with pytest.raises(ConfigError):
            propose(tmp_path / "companion.toml", {"camera.rate": 5.0})
    with pytest.raises(ConfigError):
        propose(tmp_path / "other.toml", {"camera.rate": 5.0})


def test_a_proposal_with_problems_is_not_written(file: Path) -> None:
    before = file.read_bytes()
    with pytest.raises(ConfigError):
        write(file, propose(file, {"camera.rate": 1000.0}))
    assert file.read_bytes() == before
    assert not list(file.parent.glob("*.1"))


def test_the_guarded_keys_are_told_also_for_the_value_before(file: Path) -> None:
    assert propose(file, {"camera.source": "v4l2:/dev/video0"}).guarded == ()
    file.write_text('[camera]\nsource = "pipe:cat x"\nwidth = 16\nheight = 16\npixel_format = "gray"\n')
    assert propose(file, {"camera.source": "v4l2:/dev/video0"}).guarded == ("camera.source",)
    (file.parent / "vehicles/rover.toml").write_text('[call]\npolicy = "hold"\n')
    assert propose(file, {"call.policy": "report"}).guarded == ("call.policy",)
    assert propose(file, {"vehicle.file": "", "camera.rate": 5.0}).guarded == ("vehicle.file",)


def test_every_setting_has_a_guard_and_free_texts_are_guarded() -> None:
    for section, table in SECTIONS.items():
        for key, check in checks_of(table).items():
            name = f"{section}.{key}" + (".wifi.url" if key == "more" else "")
            guard = guard_of(name, "../../etc/x")
            if check.schema.get("type") == "string" or key == "more":
                assert guard is Guard.LOOPBACK, name
    for key, value in (
        ("words.rock", 1.0),
        ("camera.source", "v4l2:/dev/anytraverse-camera"),
        ("link.url", "serial:/dev/anytraverse-autopilot:57600"),
        ("link.url", "serial:/dev/serial/by-id/usb-Hex_CubeOrange-if00:115200"),
        ("link.url", None),
        ("roi.far", None),
        ("call.votes", 3),
    ):
        assert guard_of(key, value) is Guard.OPEN, key
    with pytest.raises(ValueError, match="is not known"):
        guard_of("camera.sorce", "x")


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("camera.source", "pipe:rm -rf /"),
        ("camera.source", "folder:/home"),
        ("camera.source", "video:/etc/passwd"),
        ("camera.source", "v4l2:/dev/../etc/passwd"),
        ("camera.source", "v4l2:/etc/passwd"),
        ("camera.source", "v4l2:dev/video0"),
        ("camera.source", "v4l2:/dev/mem"),
        ("camera.source", None),
        ("camera.source", ["oak:"]),
        ("camera.calibration", "lens.yaml"),
        ("perceiver.name", "builtin:/tmp/evil.onnx"),
        ("perceiver.name", "clipseg:folder"),
        ("vehicle.file", "vehicles/atv.toml"),
        ("link.url", "udpin:0.0.0.0:14550"),
        ("link.url", "tcp:10.0.0.7:5760"),
        ("link.url", "serial:/home/x:9600"),
        ("link.url", "serial:/dev/sda:9600"),
        ("link.url", "udpin:127.0.0.1.evil:1"),
        ("link.signing_key", "key"),
        ("link.signing_key", None),
        ("link.unsigned_autopilot", True),
        ("link.allowed_senders", [1, 255]),
        ("link.more.wifi.url", "udpin:127.0.0.1:14551"),
        ("link.more.wifi.pace", 0.05),
        ("web.listen", "127.0.0.1:8191"),
        ("web.token", ""),
        ("live.listen", "0.0.0.0:8765"),
        ("video.listen", ""),
        ("video.url", "rtsp://a:1/b"),
        ("video.encoder", "x264enc"),
        ("video.python", "/usr/bin/python3"),
        ("journal.folder", "/tmp"),
        ("call.policy", "hold"),
        ("call.policy", "guide"),
        ("call.policy", None),
        ("call.policy", 1),
        ("call.px4_deadman", "manual_control"),
        ("call.fault_ends_hold", True),
        ("stopping.unchecked", True),
        ("stopping.speed", 1.2),
        ("mount.height", 1.0),
        ("perceiver.name", "builtin"),
        ("perceiver.precision", "int8"),
        ("perceiver.providers", ["CUDA"]),
        ("link.system_id", 77),
        ("recording.size", 20),
    ],
)
def test_what_runs_reads_lets_in_or_commands_is_guarded(key: str, value: object) -> None:
    assert guard_of(key, value) is Guard.LOOPBACK


def test_words_are_guarded_where_only_the_perceiver_s_bundle_knows_them(file: Path) -> None:
    for key, value in (("words.zebra", -1.0), ("aliases.zebra", "rock"), ("vocabulary", ["zebra"])):
        for name, guarded in (("builtin", ()), ("builtin:lexicon", ()), ("classes:bundle", (key,))):
            file.write_text(f'[perceiver]\nname = "{name}"\n[words]\ngrass = 1.0\n')
            assert propose(file, {key: value}).guarded == guarded, (key, name)


def test_a_proposal_shows_no_secret_in_its_representation(file: Path) -> None:
    proposal = propose(file, {"web.token": "0123456789abcdef-secret"})
    assert "0123456789abcdef-secret" in proposal.after
    assert "secret" not in repr(proposal)
    assert isinstance(proposal, Proposal)
