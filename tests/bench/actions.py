"""Rates of action code: `python3 tests/bench/actions.py PROGRAM [PROGRAM...]`.

Starts each program on a database of its own, and posts to /v1/replay, from four connections for four seconds in turn: the answers of tests/actions/answers under `mindcraft`, and the conformance files that end under `published`. Then
10,000 awaited placements under both profiles, nine times each. Prints medians of three rounds. Client and service share the machine.
"""

import http.client
import json
import pathlib
import statistics
import subprocess
import sys
import tempfile
import threading
import time

ROOT = pathlib.Path(__file__).parents[2]
SECONDS = 4


def answers() -> list[bytes]:
    bodies = []
    for folder in sorted((ROOT / "tests/actions/answers").iterdir()):
        files = sorted(file for file in folder.glob("[0-9]*") if file.suffix != ".json") if folder.is_dir() else []
        if files:
            code = [file.read_text(errors="replace") for file in files]
            bodies.append(json.dumps({"profile": "mindcraft", "action_code": code if len(code) > 1 else code[0]}).encode())
    return bodies


def published() -> list[bytes]:
    files = sorted((ROOT / "tests/conformance/actions").glob("*.js"))
    return [json.dumps({"profile": "published", "action_code": file.read_text()}).encode() for file in files]


def placements(profile: str) -> bytes:
    code = "for (let i = 0; i < 10000; i++) await skills.placeBlock(bot, 'stone', i % 100, Math.floor(i / 100) % 100, 0);"
    return json.dumps({"profile": profile, "action_code": code}).encode()


class Program:
    def __init__(self, path: str) -> None:
        self.path, self.folder = path, tempfile.TemporaryDirectory()
        command = [path, "serve", "--open", "--listen", "127.0.0.1:0", "--database", f"{self.folder.name}/p.db"]
        self.process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env={"RUST_LOG": "warn", "PATH": "/usr/bin:/bin"})
        for line in self.process.stderr:
            if "http://" in line:
                self.address = line.split("http://")[1].split("/")[0]
                break
        threading.Thread(target=lambda: [None for _ in self.process.stderr], daemon=True).start()

    def post(self, connection: http.client.HTTPConnection, body: bytes) -> int:
        connection.request("POST", "/v1/replay", body, {"content-type": "application/json"})
        answer = connection.getresponse()
        answer.read()
        return answer.status

    def rate(self, bodies: list[bytes]) -> float:
        done, end = [0] * 4, time.monotonic() + SECONDS

        def client(number: int) -> None:
            connection, at = http.client.HTTPConnection(self.address), number
            while time.monotonic() < end:
                self.post(connection, bodies[at % len(bodies)])
                done[number] += 1
                at += 4

        clients = [threading.Thread(target=client, args=(number,)) for number in range(4)]
        [one.start() for one in clients]
        [one.join() for one in clients]
        return sum(done) / SECONDS

    def time(self, body: bytes) -> float:
        connection, times = http.client.HTTPConnection(self.address), []
        for _ in range(9):
            begun = time.monotonic()
            assert self.post(connection, body) == 200
            times.append((time.monotonic() - begun) * 1000)
        return statistics.median(times)


programs = [Program(path) for path in sys.argv[1:]]
# Files that reach a limit, and are refused, are left out.
one = http.client.HTTPConnection(programs[0].address)
ended = [[body for body in bodies if programs[0].post(one, body) == 200] for bodies in (answers(), published())]
kinds = dict(zip(("mindcraft, answers a second", "published, files a second"), ended))
for name, bodies in kinds.items():
    rates = [[program.rate(bodies) for program in programs] for _ in range(3)]
    for at, program in enumerate(programs):
        own = [round_[at] for round_ in rates]
        print(f"{program.path}: {name}: {statistics.median(own):.0f} (rounds {', '.join(f'{one:.0f}' for one in own)}; {len(bodies)} bodies)")
for profile in ("mindcraft", "published"):
    for program in programs:
        print(f"{program.path}: 10,000 placements under {profile}: {program.time(placements(profile)):.0f} ms")
for program in programs:
    program.process.kill()
