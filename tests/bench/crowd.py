"""One owner among five whose logs are the slowest that are allowed: `python3 tests/bench/crowd.py PROGRAM [SECONDS]`.

Starts the program on a database of its own. Five owners fill the queue, each with logs of 100,000 blocks scattered in a cube of 120 for a task whose checks walk through the air, and each with cubes of 8,000 blocks for a task with a
stress check. Meanwhile a sixth owner posts builders' logs, one after another, and waits until each is graded, and a trainer posts such logs to /v1/grade, twenty a second. Prints the median, the 99th percentile and the maximum of both, before
the five come and while they are there. Client and service share the machine.
"""

import atexit
import http.client
import json
import random
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable

SCATTERED = "bedrooms/r5-build"
STRESSED = "stressed"
OWNERS = 5
LOGS_EACH = 12

program = sys.argv[1]
seconds = float(sys.argv[2]) if len(sys.argv) > 2 else 20
folder = tempfile.TemporaryDirectory()
database = f"{folder.name}/p.db"
environment = {"RUST_LOG": "warn", "PATH": "/usr/bin:/bin"}


def run(*arguments: str) -> str:
    return subprocess.run([program, *arguments], check=True, capture_output=True, text=True, env=environment).stdout


def key(owner: str) -> str:
    return next(word for word in run("keys", "create", "--name", owner, "--database", database).split() if word.startswith("plk_"))


def request(method: str, path: str, own_key: str, body: bytes | None = None) -> tuple[int, dict]:
    connection = http.client.HTTPConnection(address)
    connection.request(method, path, body, {"content-type": "application/json", "authorization": f"Bearer {own_key}"})
    answer = connection.getresponse()
    text = answer.read()
    connection.close()
    return answer.status, json.loads(text)


def cube(side: int) -> list[list[int]]:
    return [[i % side, i // side // side, i // side % side, 0] for i in range(side**3)]


def scattered() -> list[list[int]]:
    draw = random.Random(1)
    return [[draw.randrange(120), draw.randrange(120), draw.randrange(120), i % 3] for i in range(100_000)]


def body(task: str, rows: list[list[int]], turns: int) -> bytes:
    turn = {"palette": ["stone", "oak_door", "red_bed"], "rows": rows}
    return json.dumps({"task": task, "turns": [turn] + [{"events": []}] * (turns - 1)}).encode()


def summary(times: list[float]) -> str:
    times = sorted(times)
    return f"{len(times)} times, p50 {statistics.median(times):.1f} ms, p99 {times[int(0.99 * (len(times) - 1))]:.1f} ms, max {times[-1]:.1f} ms"


def observe(until: float, logs: list[bytes], keys: tuple[str, str]) -> tuple[list[float], list[float]]:
    graded: list[float] = []
    answered: list[float] = []
    faults: list[BaseException] = []

    def noting(work: Callable[[], None]) -> Callable[[], None]:
        def run_and_note() -> None:
            try:
                work()
            except BaseException as fault:
                faults.append(fault)

        return run_and_note

    def submitter() -> None:
        at = 0
        while time.monotonic() < until:
            begun = time.monotonic()
            status, posted = request("POST", "/v1/submissions", keys[0], logs[at % len(logs)])
            assert status == 202, posted
            while request("GET", f"/v1/submissions/{posted['id']}", keys[0])[1]["state"] in ("queued", "grading"):
                time.sleep(0.005)
            graded.append((time.monotonic() - begun) * 1000)
            at += 1
            time.sleep(0.05)

    def trainer() -> None:
        at = 0
        while time.monotonic() < until:
            begun = time.monotonic()
            status, answer = request("POST", "/v1/grade", keys[1], logs[at % len(logs)])
            assert status == 200, answer
            answered.append((time.monotonic() - begun) * 1000)
            at += 1
            time.sleep(0.05)

    threads = [threading.Thread(target=noting(submitter)), threading.Thread(target=noting(trainer))]
    [one.start() for one in threads]
    [one.join() for one in threads]
    if faults:
        raise faults[0]
    return graded, answered


command = [program, "serve", "--listen", "127.0.0.1:0", "--database", database, "--rate-per-key", "0", "--grade-cache-mib", "0"]
process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env=environment)
atexit.register(process.kill)
address = None
for line in process.stderr:
    if "http://" in line:
        address = line.split("http://")[1].split("/")[0].strip()
        break
if address is None:
    sys.exit("the program ended before it listened")
threading.Thread(target=lambda: [None for _ in process.stderr], daemon=True).start()

owners = [key(f"crowd{number}") for number in range(OWNERS)]
own_keys = (key("alone"), key("trainer"))

small = run("build", "--all", "100", "300").splitlines()
small = [line.encode() for line in small if "layer-roofs" not in line and '"task":"stressed' not in line]
tasks = request("GET", "/v1/tasks?limit=1000", own_keys[0])[1]["tasks"]
by_id = {task["id"]: task for task in tasks}
stressed = next(id for id in by_id if id.startswith(STRESSED))
print("alone: submitted until graded:", *[summary(times) for times in observe(time.monotonic() + seconds, small, own_keys)], sep="\n  ")

walked = body(SCATTERED, scattered(), by_id[SCATTERED]["turns"])
heavy = body(stressed, cube(20), by_id[stressed]["turns"])
ids = []
for round_ in range(LOGS_EACH):
    for owner in owners:
        for log in (walked, heavy):
            status, answer = request("POST", "/v1/submissions", owner, log)
            assert status == 202, answer
            ids.append((owner, answer["id"]))
print(f"{len(ids)} logs of five owners wait")
print("among them: submitted until graded, then /v1/grade:", *[summary(times) for times in observe(time.monotonic() + seconds, small, own_keys)], sep="\n  ")
left = [id for owner, id in ids if request("GET", f"/v1/submissions/{id}", owner)[1]["state"] in ("queued", "grading")]
print(f"{len(left)} of their logs still wait")
