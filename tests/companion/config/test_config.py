"""Configuration: what is refused, how it is said, and that the shipped files tell the truth."""

from __future__ import annotations

import json
from dataclasses import fields, replace
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anytraverse.errors import SettingsError
from anytraverse.perception import DefaultThresholds, Perceiver
from anytraverse.perception.runtime import Runtime
from companion.cameras import CameraOptions
from companion.config import Config, ConfigError, Problem, format_config, load_config
from companion.config.checks import checks_of
from companion.config.schema import SECTIONS
from companion.daemon.settings.runtime import call_numbers, restored_policy
from companion.vision.warm_up import judging_settings, load_and_warm_up, load_engine
from companion.wire.ids import Policy

_OWN = cast(Perceiver, SimpleNamespace(defaults=DefaultThresholds(roi=0.31, scene=0.86, tile=0.41)))
_NO_VEHICLE = '[vehicle]\nfile = ""\n'


def _write(folder: Path, text: str, vehicle: str | None = None) -> Path:
    path = folder / "companion.toml"
    if vehicle is None:
        path.write_text(text + ("" if "[vehicle]" in text else _NO_VEHICLE))
    else:
        path.write_text(text)
        (folder / "vehicles").mkdir()
        (folder / "vehicles/rover.toml").write_text(vehicle)
    return path


def _problems(folder: Path, text: str, vehicle: str | None = None) -> list[str]:
    path = _write(folder, text, vehicle)
    with pytest.raises(ConfigError) as caught:
        load_config(path)
    return [str(problem).replace(f"{folder}/", "") for problem in caught.value.problems]


def test_nothing_set_gives_the_defaults(tmp_path: Path) -> None:
    assert load_config(_write(tmp_path, "")) == replace(
        Config(), vehicle=load_config(_write(tmp_path, "")).vehicle
    )


def test_a_problem_names_file_line_key_value_and_reason(tmp_path: Path) -> None:
    assert _problems(tmp_path, "[call]\n\nwindow = 0\n") == [
        "companion.toml:3: call.window = 0: give a whole number from 1 to 60"
    ]


def test_all_problems_are_told_at_once(tmp_path: Path) -> None:
    told = _problems(
        tmp_path, '[camera]\nrate = "fast"\nlop = true\n[pictures]\nkeep = -1\n[lnk]\nurl = "x"\n'
    )
    assert told == [
        'companion.toml:6: lnk: is not known; did you mean "link"?',
        "companion.toml:2: camera.rate = 'fast': give a number from 0.5 to 60",
        'companion.toml:3: camera.lop: is not known; did you mean "loop"?',
        "companion.toml:5: pictures.keep = -1: give a whole number from 0 to 10000",
    ]


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("votes = 2\n", "votes: belongs below [call]"),
        ("[camera]\nurl = 'x'\n", "camera.url: is not known; it belongs below [link]"),
        (
            "[pictures]\n# [call]\npolicy = 'hold'\n",
            "it belongs below [call]: write that headline above it, or take its # away",
        ),
        ("[camera]\nzzz = 1\n", "known are source, rate, playback, loop, view"),
        ("camera = 3\n", "camera: is a table: write [camera]"),
        ("[camera]\nsource = 'webcam:0'\n", "names no camera"),
        ("[camera]\nsource = 3\n", "give a text in quotes"),
        ("[camera]\nrate = nan\n", "give a number from 0.5 to 60"),
        ("[camera]\nrate = inf\n", "give a number from 0.5 to 60"),
        ("[camera]\nrate = true\n", "give a number from 0.5 to 60"),
        ("[camera]\nloop = 1\n", "give true or false"),
        (
            "[perceiver]\nname = 'clipsegg:x'\n",
            "no perceiver is called that: begin with one of builtin, clipseg",
        ),
        ("[perceiver]\nproviders = []\n", "give a list of 1 to"),
        ("[perceiver]\nproviders = 'CPU'\n", "give a list of 1 to"),
        ("[perceiver]\nproviders = ['Cuda']\n", "choose one of CPU, CUDA, TensorRT"),
        ("[perceiver]\nthreads = -1\n", "give a whole number from 0 to 256"),
        ("[perceiver]\nprecision = 'fp16'\n", "choose one of auto, fp32, int8"),
        ("[perceiver]\nscene_every = 0\n", "give a whole number from 1 to 100"),
        ("[call]\nvotes = 2.0\n", "give a whole number"),
        ("[call]\nvotes = true\n", "give a whole number"),
        ("[call]\npolicy = 'stop'\n", "choose one of report, shadow, hold"),
        ("[call]\nvotes = 5\n", "votes 5 must be at most window 3"),
        ("[call]\nwindow = 1\n", "call.window = 1: votes 2 must be at most window 1"),
        ("[roi]\nleft = 0.7\n", "left 0.7 must be less than right 0.667"),
        ("[roi]\ntop = 0.5\nbottom = 0.5\n", "top 0.5 must be less than bottom 0.5"),
        ("[thresholds]\nroi = 0\n", "give a number above 0 and up to 1"),
        ("[thresholds]\ntile = 'of'\n", 'or "off"'),
        ("[corridor]\ntop = -1\n", "give a number above 0"),
        ("[corridor]\ntop_row = 0.96\n", "top_row 0.96 must be less than bottom_row 0.95"),
        ("[link]\nurl = 'udp:14550'\n", "is not understood"),
        ("[link]\nbudget = 10\n", "link.budget = 10: budget 10 B/s is too little"),
        (
            "[link]\nurl = 'serial:/dev/x:9600'\n",
            ":2: link.url = 'serial:/dev/x:9600': budget and asked_budget may",
        ),
        (
            "[link]\nurl = 'serial:/dev/x:57600'\nbudget = 0\n",
            ":3: link.budget = 0: budget and asked_budget may",
        ),
        ("[link]\nallowed_senders = [255, 245]\n", "the smaller one first"),
        ("[link]\nallowed_senders = [255]\n", "give a list of 2 values"),
        ("[words]\ngrass = 2\n", "words.grass = 2: give a number from -1 to 1"),
        ("[words]\n'a:b' = 1\n", "leave them out"),
        ("[words]\nGrass = 1\ngrass = -1\n", '"grass" stands twice'),
        ("words = ['grass']\n", "is a table: write [words]"),
        ("vocabulary = 'grass'\n", "give a list of 0 to 24 values"),
        ("vocabulary = [1]\n", "give a text in quotes"),
        ("[aliases]\ngrass = 'GRAS'\n", "is not in the configured vocabulary"),
        ("[words]\ngrass=1\n[aliases]\ngrass = 'too long a name'\n", "needs an alias of 1 to"),
        ("vocabulary = ['very long word a', 'very long word b']\n", "give one an alias"),
    ],
)
def test_a_wrong_setting_is_refused_with_what_to_do(tmp_path: Path, text: str, reason: str) -> None:
    (problem,) = _problems(tmp_path, text)
    assert reason in problem
    assert problem.startswith("companion.toml:")


def test_seventeen_words_are_too_many(tmp_path: Path) -> None:
    words = "".join(f"w{letter} = 1\n" for letter in "abcdefghijklmnopq")
    (problem,) = _problems(tmp_path, f"[words]\n{words}")
    assert "companion.toml:1: words: 17 words: 16 at most" in problem


def test_more_than_24_offered_words_are_too_many(tmp_path: Path) -> None:
    listed = [f"w{letter}" for letter in "abcdefghijklmnopqrstuvwx"]
    (problem,) = _problems(tmp_path, f"vocabulary = {listed}\n[words]\ngrass = 1\n")
    assert "25 words are configured, at most 24 fit" in problem


def test_broken_toml_is_told_with_its_line(tmp_path: Path) -> None:
    (problem,) = _problems(tmp_path, "[camera]\n[mount\nrate = 10\n")
    assert problem.startswith("companion.toml:2: ")
    assert problem.endswith("mend the TOML")


@pytest.mark.parametrize(
    ("raw", "reason"),
    [
        (b"\xff\xfe[\0", "is not UTF-8"),
        (b"#" * (1 << 20) + b"##", "larger than 1 MiB"),
        (b"x=" + b"[" * 9999, "companion"),
    ],
)
def test_a_file_that_is_no_configuration_is_refused(tmp_path: Path, raw: bytes, reason: str) -> None:
    (tmp_path / "companion.toml").write_bytes(raw)
    with pytest.raises(ConfigError, match=reason):
        load_config(tmp_path / "companion.toml")


def test_an_absent_file_says_how_to_get_one(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="companion init"):
        load_config(tmp_path / "companion.toml")


def test_a_folder_is_no_file(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="cannot be read: is a directory"):
        load_config(tmp_path)


def test_windows_line_ends_change_no_line_number(tmp_path: Path) -> None:
    (tmp_path / "companion.toml").write_bytes(b'[vehicle]\r\nfile = ""\r\n[camera]\r\nrate = 0\r\n')
    with pytest.raises(ConfigError, match=r"companion\.toml:4: camera\.rate"):
        load_config(tmp_path / "companion.toml")


def test_the_vehicles_file_counts_where_companion_toml_is_silent(tmp_path: Path) -> None:
    config = load_config(
        _write(
            tmp_path,
            "[roi]\ntop = 0.4\n[words]\nsand = 1\n",
            'vocabulary = ["rock"]\n[roi]\ntop = 0.5\nbottom = 0.9\n[words]\ngrass = 1\nbush = -1\n',
        )
    )
    assert (config.roi.top, config.roi.bottom) == (0.4, 0.9)
    assert config.words == {"sand": 1.0}
    assert config.vocabulary == ("sand", "rock")


def test_a_problem_in_the_vehicles_file_names_that_file(tmp_path: Path) -> None:
    told = _problems(tmp_path, "", '[link]\nurl = "x"\n[roi]\ntop = 2\n')
    assert told == [
        "vehicles/rover.toml:1: link: does not belong in a vehicle's file: move it to companion.toml",
        "vehicles/rover.toml:4: roi.top = 2: give a number from 0 to 1",
    ]


def test_sides_from_two_files_must_fit_together(tmp_path: Path) -> None:
    (problem,) = _problems(tmp_path, "[roi]\nleft = 0.6\n", "[roi]\nright = 0.5\n")
    assert problem == "companion.toml:2: roi.left = 0.6: left 0.6 must be less than right 0.5"


def test_a_vehicles_file_that_is_absent_is_told(tmp_path: Path) -> None:
    (problem,) = _problems(tmp_path, '[vehicle]\nfile = "vehicles/tank.toml"\n')
    assert problem.startswith("companion.toml:2: vehicle.file = 'vehicles/tank.toml': there is no file")


_SCALARS = st.one_of(
    st.integers(-5, 300), st.floats(), st.booleans(), st.text(max_size=6), st.just("~x\\0/a")
)
_ANYTHING = st.one_of(
    _SCALARS, st.lists(_SCALARS, max_size=3), st.dictionaries(st.text(max_size=3), _SCALARS)
)
_KEYS = st.sampled_from([field.name for section in SECTIONS.values() for field in fields(section)])
_NAMES = st.sampled_from([*SECTIONS, "words", "vocabulary", "aliases", "lnk"])


def _toml(value: object) -> str:
    if isinstance(value, dict):
        return "{" + ", ".join(f"{_toml(key)} = {_toml(one)}" for key, one in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_toml, value)) + "]"
    if isinstance(value, float):
        return repr(value)
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")


@settings(max_examples=80, deadline=None)
@given(
    st.dictionaries(_NAMES, st.one_of(_ANYTHING, st.dictionaries(_KEYS, _ANYTHING, max_size=4)), max_size=4)
)
def test_whatever_stands_in_a_file_it_loads_or_is_told(
    tmp_path_factory: pytest.TempPathFactory, data: dict[str, object]
) -> None:
    path = tmp_path_factory.mktemp("config") / "companion.toml"
    data.setdefault("vehicle", {"file": ""})
    path.write_text(
        "".join(f"{_toml(key)} = {_toml(value)}\n" for key, value in data.items()), encoding="utf-8"
    )
    problems: tuple[Problem, ...] = ()
    try:
        load_config(path)
    except ConfigError as error:
        problems = error.problems
    assert all(problem.line is not None and problem.reason for problem in problems)


def test_words_are_kept_in_their_one_spelling(tmp_path: Path) -> None:
    config = load_config(_write(tmp_path, '[words]\n" Dry  GRASS" = 1\n'))
    assert dict(config.preferences) == {"dry grass": 1.0}


@pytest.mark.parametrize(("rate", "limit"), [(10, 1.0), (3, 1.0), (2, 1.5), (1, 2.0), (0.5, 2.0)])
def test_freshness_follows_the_frame_period(tmp_path: Path, rate: float, limit: float) -> None:
    assert load_config(_write(tmp_path, f"[camera]\nrate = {rate}\n")).freshness == limit


def test_freshness_may_be_said(tmp_path: Path) -> None:
    assert load_config(_write(tmp_path, "[call]\nfreshness = 0.7\n")).freshness == 0.7


def test_the_journal_lies_where_systemd_says_unless_config_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HOME", "/home/someone")
    monkeypatch.delenv("STATE_DIRECTORY", raising=False)
    journal = load_config(_write(tmp_path, "")).journal
    assert journal.path == Path("/home/someone/.local/state/anytraverse")
    monkeypatch.setenv("STATE_DIRECTORY", "/var/lib/anytraverse:/var/lib/other")
    assert journal.path == Path("/var/lib/anytraverse")
    assert load_config(_write(tmp_path, '[journal]\nfolder = "~/mine"\n')).journal.path == Path(
        "/home/someone/mine"
    )


@pytest.mark.parametrize(
    ("name", "meant"),
    [
        ("builtin", "builtin"),
        ("builtin:lexicon", "builtin:lexicon"),
        ("builtin:mine.onnx", "builtin:{folder}/mine.onnx"),
        ("clipseg:/opt/bundle", "clipseg:/opt/bundle"),
        ("clipseg:models/clipseg", "clipseg:{folder}/models/clipseg"),
        ("clipseg:~/clipseg", "clipseg:/home/someone/clipseg"),
        ("clipseg:", "clipseg:"),
    ],
)
def test_a_bundle_lies_beside_the_file_unless_its_path_is_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, meant: str
) -> None:
    monkeypatch.setenv("HOME", "/home/someone")
    _write(tmp_path, f'[perceiver]\nname = "{name}"\n')
    monkeypatch.chdir(tmp_path)
    for path in (tmp_path / "companion.toml", Path("companion.toml")):
        assert load_config(path).perceiver.name == meant.format(folder=tmp_path)


def test_the_signing_key_lies_beside_the_file_unless_its_path_is_whole(tmp_path: Path) -> None:
    for written, meant in (
        ("keys/radio", str(tmp_path / "keys/radio")),
        ("/etc/radio.key", "/etc/radio.key"),
    ):
        config = load_config(_write(tmp_path, f'[link]\nsigning_key = "{written}"\n'))
        assert config.link.signing_key == meant


def test_the_journal_lies_beside_the_file_unless_its_path_is_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    _write(tmp_path, '[journal]\nfolder = "state"\n')
    for path in (tmp_path / "companion.toml", Path("../companion.toml")):
        assert load_config(path).journal.path.resolve() == tmp_path / "state"
    assert load_config(_write(tmp_path, '[journal]\nfolder = "/var/x"\n')).journal.path == Path("/var/x")


def test_an_unsigned_autopilot_needs_a_key_for_the_rest(tmp_path: Path) -> None:
    (problem,) = _problems(tmp_path, "[link]\nunsigned_autopilot = true\n")
    assert "counts only with a signing_key" in problem


def test_how_networks_are_run_reaches_their_runtime(tmp_path: Path) -> None:
    text = '[perceiver]\nproviders = ["CUDA", "CPU"]\nthreads = 3\nprecision = "int8"\nscene_every = 5\n'
    config = load_config(_write(tmp_path, text))
    assert config.perceiver.runtime == Runtime(("CUDA", "CPU"), 3, "int8")
    assert judging_settings(config, _OWN).scene_every == 5


def test_unset_thresholds_are_the_perceivers_own(tmp_path: Path) -> None:
    limits = judging_settings(load_config(_write(tmp_path, "")), _OWN).thresholds
    assert (limits.roi, limits.scene, limits.tile, limits.trav) == (0.31, 0.86, 0.41, 0.4)


def test_set_thresholds_override_and_a_tile_can_be_off(tmp_path: Path) -> None:
    config = load_config(_write(tmp_path, '[thresholds]\nroi = 0.2\nscene = 0.0\ntile = "off"\ntrav = 0.0\n'))
    limits = judging_settings(config, _OWN).thresholds
    assert (limits.roi, limits.scene, limits.tile, limits.trav) == (0.2, 0.0, None, 0.0)


def test_a_file_whose_region_is_too_narrow_is_refused_by_commands_and_runs_as_a_fault(tmp_path: Path) -> None:
    config = load_config(_write(tmp_path, "[roi]\nleft = 0.46\nright = 0.54\n[corridor]\ntop_row = 0.5\n"))
    with pytest.raises(SettingsError, match=r"ROI 0\.08 wide, vehicle 0\.30: widen it"):
        load_engine(config, None)
    judging = load_and_warm_up(config, None).engine.settings
    assert judging.misfit == "ROI 0.08 wide, vehicle 0.30: widen it"
    assert judging.corridor.top_row == 0.5


def test_the_state_machine_gets_its_numbers(tmp_path: Path) -> None:
    text = '[call]\npolicy = "hold"\nvotes = 3\nwindow = 4\nok_frames = 6\ngo_lasts = 30\nfreshness = 1.5\n'
    config = load_config(_write(tmp_path, text))
    numbers = call_numbers(config, judging_settings(config, _OWN))
    assert restored_policy(config, None, 0.0).in_force is Policy.HOLD
    assert (numbers.votes, numbers.window, numbers.ok_frames, numbers.go_lasts) == (3, 4, 6, 30.0)
    assert (numbers.judging.votes, numbers.judging.window, numbers.freshness) == (3, 4, 1.5)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("[link.more.wifi]\nurl = 'udp:1'\n", ":2: link.more.wifi.url = 'udp:1': link"),
        ("[link.more.wifi]\nbudget = 0\n", ":1: link.more.wifi: needs a url"),
        (
            "[link.more.sik]\nurl = 'serial:/dev/x:9600'\n",
            ":2: link.more.sik.url = 'serial:/dev/x:9600': budget",
        ),
        (
            "[link.more.sik]\nurl = 'serial:/dev/x:9600'\nbudget = 90\n",
            ":3: link.more.sik.budget = 90: budget",
        ),
        (
            "[link.more.wifi]\nurl = 'udpin:0.0.0.0:1'\nbudgt = 0\n",
            ":3: link.more.wifi.budgt: is not known",
        ),
        (
            "[link.more.wifi]\nurl = 'udpin:0.0.0.0:1'\nbudget = 1\n",
            ":3: link.more.wifi.budget = 1: budget 1",
        ),
        ("[link.more.wifi]\nurl = 'udpin:0.0.0.0:1'\npace = 'x'\n", ":3: link.more.wifi.pace = 'x': give a"),
        (
            "[link]\nurl = 'udpin:0.0.0.0:1'\n[link.more.wifi]\nurl = 'udpin:0.0.0.0:1'\n",
            ":4: link.more.wifi.url = 'udpin:0.0.0.0:1': more.wifi.url is that of [link] too",
        ),
        ("[link.more.Wifi]\nurl = 'udpin:0.0.0.0:1'\n", ":1: link.more.Wifi: more.Wifi: choose a name like"),
        ("[link.more.main]\nurl = 'udpin:0.0.0.0:1'\n", ":1: link.more.main: more.main: choose a name like"),
        ("[link]\nmore = 'udpin:0.0.0.0:1'\n", "give each connection a name and its settings"),
        (
            "".join(f"[link.more.{name}]\nurl = 'udpin:0.0.0.0:{ord(name)}'\n" for name in "abcd"),
            ":1: link.more: more: 4 are too many, 3 at most",
        ),
    ],
)
def test_a_wrong_connection_is_refused_on_its_line(tmp_path: Path, text: str, reason: str) -> None:
    (problem,) = _problems(tmp_path, text)
    assert reason in problem


def test_connections_are_read_printed_and_read_again_with_budgets_of_their_own(tmp_path: Path) -> None:
    path = tmp_path / "companion.toml"
    path.write_text("[vehicle]\nfile = ''\n[link.more.wifi]\nurl = 'udpin:0.0.0.0:14551'\nbudget = 0\n")
    config = load_config(path)
    connections = config.link.settings().connections()
    assert list(connections) == ["main", "wifi"]
    assert (connections["main"].budget, connections["wifi"].budget) == (300.0, 0.0)
    path.write_text(format_config(config))
    assert load_config(path).link == config.link


@pytest.mark.parametrize(
    ("more", "why"),
    [
        ("", r"a pipe needs \[camera\] width, height"),
        ("width = 640\nheight = 480", r"a pipe needs \[camera\] width, height"),
        ('width = 640\nheight = 480\npixel_format = "mjpeg"', r"a pipe needs \[camera\] width, height"),
        ('width = 641\nheight = 480\npixel_format = "nv12"', "an even width and height"),
        ('width = 640\npixel_format = "nv12"', "width and height go together"),
    ],
)
def test_a_pipe_without_its_size_and_format_is_refused(tmp_path: Path, more: str, why: str) -> None:
    path = tmp_path / "companion.toml"
    path.write_text(f'[camera]\nsource = "pipe:true"\n{more}\n[vehicle]\nfile = ""\n')
    with pytest.raises(ConfigError, match=why):
        load_config(path)


def test_only_an_oak_measures_depth(tmp_path: Path) -> None:
    path = tmp_path / "companion.toml"
    path.write_text('[camera]\nsource = "v4l2:0"\ndepth = true\n[vehicle]\nfile = ""\n')
    with pytest.raises(ConfigError, match="only an oak camera measures depth"):
        load_config(path)
    path.write_text('[camera]\nsource = "oak:"\ndepth = true\n[vehicle]\nfile = ""\n')
    assert load_config(path).camera_options.depth


def test_the_options_of_a_camera_are_those_of_the_file_and_t(tmp_path: Path) -> None:
    path = tmp_path / "companion.toml"
    path.write_text(
        '[camera]\nsource = "v4l2:0"\nwidth = 640\nheight = 480\npixel_format = "mjpeg"\nfps = 15\n'
        'exposure = 0.01\nlatency = 0.1\nrate = 2\n[vehicle]\nfile = ""\n'
    )
    assert load_config(path).camera_options == CameraOptions(
        width=640, height=480, pixel_format="mjpeg", fps=15.0, exposure=0.01, latency=0.1, freshness=1.5
    )


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("[camera]\nsource = 'rtsp://me:SECRET@cam/1'\nrate = 0\n", ":3: camera.rate = 0: "),
        ("[camera]\nsource = 'rstp://me:SECRET@cam/1'\n", ":2: camera.source = '...': "),
        ("[camera]\nsource = ['rtsp://me:SECRET@cam/1']\n", ":2: camera.source = ['rtsp://cam/...']: "),
        ("[camera]\nsorce = 'rtsp://me:SECRET@cam/1'\n", ":2: camera.sorce: is not known"),
        ("[web]\ntokn = 'SECRET'\n", ":2: web.tokn: is not known"),
        ("[web]\ntoken = 5ECRE7\n", ":2: "),
        ("[web]\ntoken = 'SECRET'\n", ":2: web.token: give 16 to 128"),
        ("[web]\nlisten = 'me:SECRET@1.2.3.4:80'\n", ":2: web.listen = '...': "),
        ("[web]\nlisten = '127.0.0.1:SECRET'\n", ":2: web.listen = '...': the port is not"),
        ("[link]\nurl = 'tcp:me:SECRET@10.0.0.1:5760'\n", ":2: link.url = 'tcp:10.0.0.1:5760/...': "),
        ("[link]\nurl = 'serial:socket://me:SECRET@10.0.0.1:57600'\n", ":2: link.url = 'serial:...': "),
        (
            "[link.more.wifi]\nurl = 'udp:me:SECRET@10.0.0.1'\n",
            ":2: link.more.wifi.url = 'udp:10.0.0.1/...': ",
        ),
        (
            "[link]\nsigning_key = 'https://me:SECRET@keys/1'\n",
            ":2: link.signing_key = 'https://keys/...': give a path",
        ),
        (
            "[journal]\nfolder = 'ftp://me:SECRET@disk/1'\n",
            ":2: journal.folder = 'ftp://disk/...': give a path",
        ),
        ("[perceiver]\nname = 'clipseg:https://me:SECRET@hub/1'\n", ":2: perceiver.name = 'clipseg:...': "),
        ("[video]\nencoder = 'x264enc key=SECRET !'\n", ":2: video.encoder: give one GStreamer element"),
        ("[video]\nurl = 'http://me:SECRET@rover/1'\n", ":2: video.url = 'http://rover/...': "),
        ("[call]\npolicy = 'http://me:SECRET@rover/1'\n", ":2: call.policy = 'http://rover/...': "),
    ],
)
def test_a_problem_shows_no_secret(tmp_path: Path, text: str, told: str) -> None:
    (problem,) = _problems(tmp_path, text)
    assert problem.startswith(f"companion.toml{told}")
    assert "SECRET" not in problem


def test_a_vehicles_file_that_is_an_address_shows_no_secret(tmp_path: Path) -> None:
    told = "".join(_problems(tmp_path, '[vehicle]\nfile = "https://me:SECRET@rover/1.toml"\n'))
    assert "companion.toml:2: vehicle.file = 'https://rover/...': " in told
    assert "SECRET" not in told


def test_a_setting_is_printed_only_as_far_as_its_check_says(tmp_path: Path) -> None:
    path = tmp_path / "companion.toml"
    path.write_text(
        f"""
        [camera]
        source = "rtsp://me:SECRET@camera.local:554/SECRET"
        [vehicle]
        file = ""
        [link]
        url = "serial:/dev/ttyAMA0:57600"
        signing_key = "radio.key"
        [journal]
        folder = "{tmp_path}"
        [video]
        listen = "127.0.0.1:8554"
        url = "rtsp://me:SECRET@rover.local:8554/anytraverse"
        encoder = "myenc key=SECRET"
        [web]
        token = "SECRET-of-16-signs"
        """
    )
    path.chmod(0o600)
    printed = format_config(load_config(path))
    assert "SECRET" not in printed
    for line in (
        'source = "rtsp://camera.local:554/..."',
        'url = "serial:/dev/ttyAMA0:57600"',
        f'signing_key = "{tmp_path}/radio.key"',
        f'folder = "{tmp_path}"',
        'listen = "127.0.0.1:8554"',
        'url = "rtsp://rover.local:8554/..."',
        "# encoder is set, and not shown",
        "# token is set, and not shown",
    ):
        assert f"\n{line}" in printed
    path.write_text(printed)
    assert load_config(path).camera.source == "rtsp://camera.local:554/..."


def test_a_setting_of_any_text_is_shown_only_where_that_is_said() -> None:
    free = [
        f"{name}.{key}"
        for name, section in SECTIONS.items()
        for key, check in checks_of(section).items()
        if check.shown is None
    ]
    assert free == ["link.more", "web.token", "video.encoder", "alert.url", "alert.link"]


def test_a_stream_of_sticks_and_an_off_switch_on_a_transmitter_exclude_each_other(tmp_path: Path) -> None:
    (told,) = _problems(tmp_path, '[call]\noff_channel = 7\npx4_deadman = "manual_control"\n')
    assert told.startswith("companion.toml:3: call.px4_deadman = 'manual_control': ")
    assert "exclude each other" in told


def test_a_stream_of_sticks_needs_a_pace_that_leaves_room_for_replies(tmp_path: Path) -> None:
    slow = '[link]\npace = 0.1\n[link.more.wifi]\nurl = "udpin:0.0.0.0:14551"\npace = 0.06\n[call]\n'
    told = _problems(tmp_path, slow + 'px4_deadman = "manual_control"\n')
    assert len(told) == 2
    assert (
        told[0] == 'companion.toml:2: link.pace = 0.1: give at most 0.05, or set [call] px4_deadman = "off"'
    )
    assert "link.more.wifi.pace = 0.06" in told[1]
    assert load_config(_write(tmp_path, slow)).call.px4_deadman == "off"
