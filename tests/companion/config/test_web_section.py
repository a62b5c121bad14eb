"""Where the page may listen, and that its token is shown to nobody."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.config import Config, ConfigError, format_config, load_config
from companion.pages.listen import Listen, read_listen

TOKEN = "a-token-of-23-characters"


def loaded(folder: Path, web: str) -> Config:
    path = folder / "companion.toml"
    path.write_text(f'[vehicle]\nfile = ""\n[web]\n{web}\n')
    path.chmod(0o600)
    return load_config(path)


@pytest.mark.parametrize(
    ("text", "listen", "url"),
    [
        ("127.0.0.1:8191", Listen("127.0.0.1", 8191), "http://127.0.0.1:8191/"),
        ("localhost:0", Listen("127.0.0.1", 0), "http://127.0.0.1:0/"),
        ("[::1]:8191", Listen("::1", 8191), "http://[::1]:8191/"),
    ],
)
def test_an_address_of_this_computer_needs_no_token(
    tmp_path: Path, text: str, listen: Listen, url: str
) -> None:
    found = loaded(tmp_path, f'listen = "{text}"').web.address
    assert found == listen
    assert found.loopback
    assert found.url() == url


def test_an_empty_address_is_no_page(tmp_path: Path) -> None:
    assert loaded(tmp_path, 'listen = ""').web.address is None


@pytest.mark.parametrize("host", ["0.0.0.0", "192.168.1.5", "[::]", "10.0.0.1"])
def test_an_address_that_others_reach_needs_a_token(tmp_path: Path, host: str) -> None:
    with pytest.raises(ConfigError, match=r"web\.listen.*other computers reach this address: set token"):
        loaded(tmp_path, f'listen = "{host}:8191"')
    assert loaded(tmp_path, f'listen = "{host}:8191"\ntoken = "{TOKEN}"').web.token == TOKEN


@pytest.mark.parametrize(
    "text", ["8191", "rover:8191", "127.0.0.1", "127.0.0.1:65536", "127.0.0.1:-1", "127.0.0.1:٣"]
)
def test_what_is_no_address_is_refused(tmp_path: Path, text: str) -> None:
    with pytest.raises(ConfigError, match=r"web\.listen"):
        loaded(tmp_path, f'listen = "{text}"')


@given(st.text(max_size=24))
def test_any_text_is_an_address_or_a_value_error(text: str) -> None:
    try:
        found = read_listen(text)
    except ValueError:
        return
    assert (found is None) == (text == "")


@pytest.mark.parametrize("token", ["short-secret-15", "secret with a space", "secret;" * 3, "s" * 129])
def test_a_weak_token_is_refused_and_not_shown(tmp_path: Path, token: str) -> None:
    with pytest.raises(ConfigError, match=r"web\.token: give 16 to 128") as refused:
        loaded(tmp_path, f'token = "{token}"')
    assert token not in str(refused.value)


def test_a_token_that_everybody_may_read_is_refused_with_what_to_type(tmp_path: Path) -> None:
    file = tmp_path / "companion.toml"
    loaded(tmp_path, f'token = "{TOKEN}"')
    file.chmod(0o644)
    with pytest.raises(
        ConfigError, match=r"web\.token: everybody on this computer may read it: chmod o-r"
    ) as why:
        load_config(file)
    assert TOKEN not in str(why.value)
    file.chmod(0o640)
    assert load_config(file).web.token == TOKEN
    file.write_text('[vehicle]\nfile = ""\n')
    file.chmod(0o644)
    load_config(file)


def test_a_token_is_not_printed(tmp_path: Path) -> None:
    printed = format_config(loaded(tmp_path, f'token = "{TOKEN}"'))
    assert TOKEN not in printed
    assert "# token is set, and not shown" in printed
