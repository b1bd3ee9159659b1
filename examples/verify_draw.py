"""Checks the proof of a draw with nothing but Python: python verify_draw.py DRAW.json EPOCH.json

DRAW.json is the response to POST /v1/entries/ID/instances, EPOCH.json what GET /v1/epochs/NAME gave before the epoch opened.
It exits with 0 if the proof holds, 1 if it does not, and 2 if the files are something else.
The function is ECVRF-EDWARDS25519-SHA512-TAI of RFC 9381; names are those of the standard.
"""
import hashlib
import json
import sys

p, q = 2**255 - 19, 2**252 + 27742317777372353535851937790883648493
d, root = -121665 * pow(121666, -1, p) % p, pow(2, (p - 1) // 4, p)


def add(a, b):
    t = d * a[0] * b[0] * a[1] * b[1]
    return ((a[0] * b[1] + b[0] * a[1]) * pow(1 + t, -1, p) % p, (a[1] * b[1] + a[0] * b[0]) * pow(1 - t, -1, p) % p)


def times(n, a):
    return (0, 1) if n == 0 else add(times(n - 1, a), a) if n % 2 else times(n // 2, add(a, a))


def to_string(a):
    return (a[1] | (a[0] & 1) << 255).to_bytes(32, "little")


def to_point(s):
    y, sign = int.from_bytes(s, "little") % 2**255, s[31] >> 7
    square = (y * y - 1) * pow(d * y * y + 1, -1, p) % p
    x = pow(square, (p + 3) // 8, p)
    x = x if x * x % p == square else x * root % p
    return ((x if x & 1 == sign else -x % p), y) if y < p and x * x % p == square and (x or not sign) else None


def sha(*parts):
    return hashlib.sha512(b"".join(parts)).digest()


def verify(key, alpha, pi):
    if len(key) != 32 or len(pi) != 80:
        return None
    Y, Gamma, c, s = to_point(key), to_point(pi[:32]), int.from_bytes(pi[32:48], "little"), int.from_bytes(pi[48:], "little")
    if not Y or not Gamma or s >= q or times(8, Y) == (0, 1):
        return None
    tries = (to_point(sha(b"\x03\x01", key, alpha, bytes([n]), b"\x00")[:32]) for n in range(256))
    H = times(8, next(point for point in tries if point))
    minus = lambda a: (-a[0] % p, a[1])
    B = to_point((4 * pow(5, -1, p) % p).to_bytes(32, "little"))
    U, V = add(times(s, B), minus(times(c, Y))), add(times(s, H), minus(times(c, Gamma)))
    if sha(b"\x03\x02", *map(to_string, (Y, H, Gamma, U, V)), b"\x00")[:16] != pi[32:48]:
        return None
    return sha(b"\x03\x03", to_string(times(8, Gamma)), b"\x00")


def check(draw, epoch):
    draw, commitment = draw.get("draw", draw), epoch.get("commitment", epoch)
    if draw["epoch"] != commitment["epoch"]:
        print(f"the draw is of the epoch {draw['epoch']!r}, and the commitment of {commitment['epoch']!r}", file=sys.stderr)
        sys.exit(2)
    if type(draw["run"]) is not int:
        return False
    alpha = "\n".join(["plumbline draw", draw["epoch"], draw["entry"], str(draw["run"]), draw["nonce"]]).encode()
    key = bytes.fromhex(commitment["draw_key"])
    try:
        proof = bytes.fromhex(draw["proof"])
    except ValueError:
        return False
    output = verify(key, alpha, proof)
    return output is not None and output.hex() == draw["output"]


if len(sys.argv) != 3 or sys.argv[1].startswith("-"):
    print(__doc__, file=sys.stderr)
    sys.exit(2)
try:
    holds = check(*(json.load(open(path, "rb")) for path in sys.argv[1:3]))
except OSError as error:
    print(f"{error.filename} cannot be read: {error.strerror}", file=sys.stderr)
    sys.exit(2)
except (AttributeError, KeyError, TypeError, ValueError) as error:
    print(f"these are not a draw and an epoch with a key of draws: {error!r}", file=sys.stderr)
    sys.exit(2)
print("the draw is as committed" if holds else "the proof does NOT hold")
sys.exit(0 if holds else 1)
