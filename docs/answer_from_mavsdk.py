"""See what a rover asks and answer it, with MAVSDK 4.1 or newer: pip install mavsdk. To copy and change.

python answer_from_mavsdk.py udpin://0.0.0.0:14550      then type: go, stay, look, or AT_W_GRASS 0.5
"""

import json
import sys
import time
from contextlib import suppress

from mavsdk import ComponentType, Configuration, Mavsdk
from mavsdk.plugins.mavlink_direct import MavlinkDirect, MavlinkDirectError, MavlinkMessage
from mavsdk.plugins.param import Param, ParamError, ProtocolVersion

COMPANION, ANSWER = 191, 31010
MOTIONS = {"go": 1, "stay": 2, "look": 3}
RESULTS = {0: "done", 1: "busy, type it again", 2: "denied: too late, or not allowed", 4: "refused"}
LOST = "no acknowledgement: it may have arrived"
heard_at: dict[int, float] = {}


def hear(message: MavlinkMessage, _: object) -> None:
    """Text and heartbeat of the companion; every other component is somebody else."""
    if message.message_name == "HEARTBEAT":
        heard_at[message.component_id] = time.monotonic()
    elif message.component_id == COMPANION:
        print(json.loads(message.fields_json)["text"], flush=True)


mavsdk = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
mavsdk.add_any_connection(sys.argv[1] if len(sys.argv) > 1 else "udpin://0.0.0.0:14550")
rover = mavsdk.first_autopilot(30.0) or sys.exit("no autopilot is heard: is the address right?")
direct, parameters = MavlinkDirect(rover), Param(rover)
for name in ("HEARTBEAT", "STATUSTEXT"):
    direct.subscribe_message(name, hear)
deadline = time.monotonic() + 30.0
while COMPANION not in heard_at:
    if time.monotonic() > deadline:
        sys.exit("no companion is heard: does it run, and on this link?")
    time.sleep(0.1)
with suppress(ParamError):  # 4.1 selects it, and calls that an error
    parameters.select_component(COMPANION, ProtocolVersion.V1)
print("type go, stay, look, or a parameter and its value", flush=True)
turning = ""  # the line that must be repeated

for line in sys.stdin:
    word, _, value = line.strip().partition(" ")
    if time.monotonic() - heard_at[COMPANION] > 3.0:  # an old ArduPilot would execute what it cannot hand on
        print("the companion is not heard", flush=True)
    elif word in MOTIONS:
        answer = {"command": ANSWER, "param1": 0, "param2": MOTIONS[word]}
        answer |= {"target_system": rover.get_system_id(), "target_component": COMPANION}
        command = MavlinkMessage(
            "COMMAND_LONG", target_component_id=COMPANION, fields_json=json.dumps(answer)
        )
        try:
            result = json.loads(direct.send_command(command).fields_json)["result"]
            print(f"{word}: {RESULTS.get(result, result)}", flush=True)
        except MavlinkDirectError:  # MAVSDK has sent it again by itself, and heard nothing
            print(f"{word}: {LOST}", flush=True)
    elif word.startswith("AT_"):
        try:
            was, now = parameters.get_param_float(word), float(value or "nan")
            turns = word.startswith("AT_W_") and was >= -1 and (was > 0) != (now > 0)
            if turns and -1 <= now <= 1 and line != turning:
                turning = line
                print(f"{word} was {was:g}: repeat it to turn it", flush=True)
                continue
            turning = ""
            if value:
                parameters.set_param_float(word, now)
            print(f"{word} = {parameters.get_param_float(word)}", flush=True)
        except ParamError as error:  # TIMEOUT is also what MAVSDK says of one that is not there
            why = LOST if error.result.name == "TIMEOUT" else f"not done, {error.result.name}"
            print(f"{word}: {why}", flush=True)
        except ValueError:
            print(f"{word}: not done, {value} is no number", flush=True)
    else:
        print("type go, stay, look, or a parameter and its value", flush=True)
