"""Hear a rover and answer it with pymavlink alone: pip install pymavlink. To copy and change.

python answer_from_python.py udpin:0.0.0.0:14550      then type: go, stay, look, go gravel 1 (with a word),
word gravel 1, command go (as COMMAND_LONG), set AT_W_GRASS 0.5, get /state.json
"""

import json
import os
import queue
import random
import struct
import sys
import threading
import time

os.environ["MAVLINK20"] = "1"
from pymavlink import mavutil

COMPANION, COMMAND, SESSION, NAK = 191, 31010, 7, 129
SUMMARY, CALL, ANSWER, ACK = 45001, 45002, 45003, 45004
STATES = ("starting", "ok", "calling", "holding", "blocked", "fault", "off")
USAGE = "type go, stay, look, go gravel 1, word gravel 1, command go, set AT_W_GRASS 0.5, or get /state.json"
MOTIONS = {"word": 0, "go": 1, "stay": 2, "look": 3}
RESULTS = ("applied", "applied, not remembered", "not covered", "stale", "refused", "denied", "busy")


def share(raw):
    return None if raw in (65535, -32768) else raw / 10_000


def read(kind, payload):
    if kind in (SUMMARY, CALL, ACK) and payload[0] != 1:
        raise ValueError(f"payload of version {payload[0]}: this client speaks 1")
    if kind == SUMMARY:
        raw = struct.unpack("<BBBBHHIHHHHHhBIH16B", payload)
        told = {"state": STATES[raw[1]], "sequence": raw[4], "id": raw[5], "traversability": share(raw[9])}
        told |= {"uncertainty": share(raw[10]), "worst tile": share(raw[11]), "similarity": share(raw[12])}
        return told | {"sectors": [None if sector == 255 else sector / 200 for sector in raw[16:]]}
    if kind == CALL:
        raw = struct.unpack_from("<BBBBBBHIH8HHHHhiiHBI", payload)
        told = {"id": raw[6], "stage": raw[2], "reasons": raw[4], "holding": bool(raw[5] & 1)}
        told |= {"frame": raw[7], "box": [share(side) for side in raw[13:17]], "uncertainty": share(raw[17])}
        return told | {"similarity": share(raw[20]), "picture": payload[54:].decode()}
    if kind == ACK:
        raw = struct.unpack_from("<BIHBBBHHBI", payload)
        return {"transaction": raw[1], "id": raw[2], "result": RESULTS[raw[3]], "text": payload[20:].decode()}
    return {}


def pack_answer(transaction, target, motion, words):
    payload = struct.pack("<BIHBBBB", 1, transaction, target, motion, 0, 1, len(words))
    for word, weight in words.items():
        payload += struct.pack("<BhB", 1, round(weight * 10_000), len(word.encode())) + word.encode()
    return payload


def spelled(word):
    return "_".join(word.upper().split())[:11]  # as the name of a word's parameter


def turned(words, known):
    """What to ask before words turn a sign, or "". known: weights in force, and those given before."""
    known = {spelled(word): weight for word, weight in known.items()}
    was = {word: known.get(spelled(word)) for word in words}
    asked = [
        f"{word} was {was[word]:g}"
        for word, weight in words.items()
        if was[word] is not None and -1 <= weight <= 1 and (weight > 0) != (was[word] > 0)
    ]
    return f"{', '.join(asked)}: repeat it to turn it" if asked else ""


class Client:
    def __init__(self, url):
        self.link = mavutil.mavlink_connection(url, source_system=255, source_component=190, dialect="common")
        self.rover = self.call = self.sequence = 0
        self.heard_at = self.told_at = float("-inf")
        self.turning = ""  # the line that must be repeated

    def hear(self):
        """A message of the companion, or None after 0.1 s. A heartbeat a second: routers answer who spoke."""
        if time.monotonic() - self.told_at > 1.0:
            self.told_at = time.monotonic()
            self.link.mav.heartbeat_send(6, 8, 0, 0, 4)
        message = self.link.recv_match(blocking=True, timeout=0.1)
        rover = message.get_srcSystem() if message and message.get_srcComponent() == COMPANION else 0
        if not rover or self.rover not in (0, rover):  # one rover's companion
            return None
        kind = message.get_type()
        if kind == "HEARTBEAT":
            self.rover, self.heard_at, self.call = rover, time.monotonic(), message.custom_mode >> 8 & 0xFFFF
        elif kind == "TUNNEL":
            message.told = read(message.payload_type, bytes(message.payload[: message.payload_length]))
        if kind in ("STATUSTEXT", "TUNNEL"):
            print(message.text if kind == "STATUSTEXT" else message.told, flush=True)
        return message

    def ask(self, message, reply_kind, is_reply, **fields):
        """Send again, with growing pauses, until the reply comes."""
        send = getattr(self.link.mav, f"{message}_send")
        for attempt in range(5):
            fields |= {"confirmation": attempt} if "confirmation" in fields else {}  # marks a repetition
            send(target_system=self.rover, target_component=COMPANION, **fields)
            deadline = time.monotonic() + 1.0 + attempt
            while time.monotonic() < deadline:
                heard = self.hear()
                if heard and heard.get_type() == reply_kind and is_reply(heard):
                    return heard
        raise TimeoutError(f"no acknowledgement: it may have arrived (no {reply_kind} came)")

    def answer(self, motion, words):
        number = random.randrange(1, 2**32)
        data = pack_answer(number, self.call, motion, words)
        fields = {"payload_type": ANSWER, "payload_length": len(data), "payload": data.ljust(128, b"\0")}

        def is_reply(heard):
            return heard.told.get("transaction") == number and heard.told["result"] != "busy"

        return self.ask("tunnel", "TUNNEL", is_reply, **fields).told["result"]

    def command(self, motion):
        fields = {f"param{place}": 0 for place in range(3, 8)} | {"param1": self.call, "param2": motion}
        fields |= {"command": COMMAND, "confirmation": 0}
        return self.ask("command_long", "COMMAND_ACK", lambda ack: ack.command == COMMAND, **fields).result

    def set(self, name, value):
        fields = {"param_id": name.encode(), "param_value": value, "param_type": 9}
        return self.ask("param_set", "PARAM_VALUE", lambda echo: echo.param_id == name, **fields).param_value

    def transfer(self, opcode, size, offset=0, data=b""):
        self.sequence = (self.sequence + 2) & 0xFFFF
        head = struct.pack("<HBBBBBBI", self.sequence, SESSION, opcode, size, 0, 0, 0, offset)
        expected = struct.pack("<H", (self.sequence + 1) & 0xFFFF)
        fields = {"target_network": 0, "payload": (head + data).ljust(251, b"\0")}
        kind = "FILE_TRANSFER_PROTOCOL"
        reply = self.ask(kind.lower(), kind, lambda heard: bytes(heard.payload[:2]) == expected, **fields)
        raw = bytes(reply.payload)
        if raw[3] == NAK:
            raise ValueError(f"NAK {raw[12]}")
        return raw[12 : 12 + raw[4]]

    def get(self, path):
        name, content = path.encode(), b""
        size = int.from_bytes(self.transfer(4, len(name), data=name), "little")
        while len(content) < size:
            content += self.transfer(5, 80, offset=len(content))
        self.transfer(1, 0)
        return content.decode(errors="replace")

    def question(self, line, words):
        """Why this line must be typed twice, "" where it need not be."""
        asked, self.turning = self.turning, ""
        if not words or line == asked:
            return ""
        state = json.loads(self.get("/state.json"))
        question = turned(words, state.get("given", {}) | state.get("words", {}))
        self.turning = line if question else ""
        return question

    def obey(self, line):
        if time.monotonic() - self.heard_at > 3.0:  # an old ArduPilot would execute what it cannot hand on
            return "the companion is not heard"
        first, *rest = line.split() or [""]
        try:
            if first == "command":
                return f"MAV_RESULT {self.command(MOTIONS[rest[0]])}"
            if first == "get":
                return self.get(rest[0])
            if first == "set":
                words = {rest[0][5:]: float(rest[1])} if rest[0].startswith("AT_W_") else {}
                return self.question(line, words) or f"{rest[0]} = {self.set(rest[0], float(rest[1]))}"
            motion, words = MOTIONS[first], {" ".join(rest[:-1]): float(rest[-1])} if rest else {}
            return self.question(line, words) or self.answer(motion, words)
        except (IndexError, KeyError):
            return USAGE
        except TimeoutError as error:
            return str(error)
        except ValueError as error:
            return f"not done: {error}"


if __name__ == "__main__":
    client = Client(sys.argv[1] if len(sys.argv) > 1 else "udpin:0.0.0.0:14550")
    typed = queue.Queue()
    threading.Thread(target=lambda: [typed.put(line) for line in sys.stdin], daemon=True).start()
    print(f"{USAGE}; what the companion says is shown when it is heard", flush=True)
    while True:
        client.hear()
        if not typed.empty():
            print(client.obey(typed.get()), flush=True)
