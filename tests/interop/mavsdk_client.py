"""What MAVSDK makes of a companion, as one line of JSON: python mavsdk_client.py udpout://HOST:PORT FOLDER"""

from __future__ import annotations

import json
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from mavsdk import ComponentType, Configuration, Mavsdk
from mavsdk.plugins.ftp import Ftp
from mavsdk.plugins.ftp.ftp import FtpError, FtpResult
from mavsdk.plugins.param import Param, ParamError, ProtocolVersion

COMPANION = 191


def main(link: str, folder: str) -> dict[str, Any]:
    """Read, set and read again, list and fetch."""
    mavsdk = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
    mavsdk.add_any_connection(link)
    rover = mavsdk.first_autopilot(30.0)
    deadline = time.monotonic() + 10.0
    while COMPANION not in rover.component_ids() and time.monotonic() < deadline:
        time.sleep(0.1)
    return {"numbers": _numbers(rover), "texts": _texts(rover), "files": _files(rover, folder)}


def _parameters(rover: Any, protocol: ProtocolVersion) -> Param:
    parameters = Param(rover)
    with suppress(ParamError):  # 4.1 selects it, and calls that an error
        parameters.select_component(COMPANION, protocol)
    return parameters


def _numbers(rover: Any) -> dict[str, Any]:
    parameters = _parameters(rover, ProtocolVersion.V1)
    listed = {each.name: each.value for each in parameters.get_all_params().float_params}
    parameters.set_param_float("AT_W_GRASS", 0.5)
    out_of_range = _error(lambda: parameters.set_param_float("AT_W_GRASS", 7.0))
    return {
        "listed": listed,
        "set": parameters.get_param_float("AT_W_GRASS"),
        "out of range": out_of_range,
        "unknown": _error(lambda: parameters.get_param_float("AT_NOT_THERE")),
    }


def _texts(rover: Any) -> dict[str, Any]:
    parameters = _parameters(rover, ProtocolVersion.EXT)
    before = parameters.get_param_custom("AT_WORDS").decode()
    parameters.set_param_custom("AT_WORDS", b"bush: -0.5; gravel: 1")
    nonsense = _error(lambda: parameters.set_param_custom("AT_WORDS", b"bush"))
    after = parameters.get_param_custom("AT_WORDS").decode()
    return {"before": before, "after": after, "nonsense": nonsense}


def _files(rover: Any, folder: str) -> dict[str, Any]:
    files = Ftp(rover)
    files.set_target_compid(COMPANION)
    listing = _error(lambda: [entry.name for entry in files.list_directory("/").entries])
    fetched = {name: _download(files, name, folder) for name in ("/state.json", "/no-such-file")}
    return {"listing": listing, **fetched}


def _download(files: Ftp, name: str, folder: str) -> str:
    over, told = threading.Event(), []

    def hear(result: FtpResult, _progress: Any, _: Any) -> None:
        if result is not FtpResult.NEXT:
            told.append(result.name)
            over.set()

    files.download_async(name, folder, True, hear)  # noqa: FBT003 - in bursts
    over.wait(20.0)
    return told[0] if told else "nothing"


def _error(call: Callable[[], Any]) -> Any:
    """What it returns, or the name of its error."""
    try:
        return call()
    except (ParamError, FtpError) as error:
        return error.result.name


if __name__ == "__main__":
    print(json.dumps(main(*sys.argv[1:])), flush=True)
