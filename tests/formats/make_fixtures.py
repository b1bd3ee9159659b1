#!/usr/bin/env python3
"""Writes the structure files of this folder, and a JSON beside each that says what it holds.

    python3 -m venv venv && venv/bin/pip install litemapy==0.11.0b0 mcschematic==11.4.4 \
        nbtlib==2.0.4 SchemPy==0.0.12 nbt-structure-utils==0.3.0 NBT==1.5.1 numpy==1.26.4
    venv/bin/python make_fixtures.py [OUT_DIR]

Same bytes on every run: times are fixed, and every file is re-gzipped with mtime 0.
Block strings in the JSON are canonical: namespaced, properties sorted by name.
"""
import datetime, gzip, hashlib, json, sys
from importlib.metadata import version
from pathlib import Path

PINS = {"litemapy": "0.11.0b0", "mcschematic": "11.4.4", "nbtlib": "2.0.4", "SchemPy": "0.0.12",
        "nbt-structure-utils": "0.3.0", "NBT": "1.5.1", "numpy": "1.26.4"}
for _name, _want in PINS.items():
    if version(_name) != _want:
        sys.exit(f"{_name} is {version(_name)}, want {_want}")

import litemapy, mcschematic, nbtlib, schempy  # noqa: E402
import nbt_structure_utils.nbt_structure as nsu  # noqa: E402
from nbt_structure_utils.blocks import BlockData  # noqa: E402
from nbt_structure_utils.shapes import Vector  # noqa: E402
from nbtlib.tag import Byte, Compound, Int, List, String  # noqa: E402

OUT = Path(sys.argv[1] if len(sys.argv) > 1 else Path(__file__).parent)
DATA_VERSION = 4189  # Java Edition 1.21.4
MILLIS = 1_733_184_000_000  # 2024-12-03T00:00:00Z
AIR = "minecraft:air"


# ---------------------------------------------------------------- block states
def split(state):
    if "[" not in state:
        return state, {}
    name, rest = state[:-1].split("[")
    return name, dict(p.split("=") for p in rest.split(","))


def canon(state):
    name, props = split(state)
    return name + ("[" + ",".join(f"{k}={props[k]}" for k in sorted(props)) + "]" if props else "")


# ---------------------------------------------------------------- the builds: dict (x, y, z) -> state, air included
DOOR = "minecraft:oak_door[facing=south,half=%s,hinge=left,open=false,powered=false]"
STAIRS = "minecraft:oak_stairs[facing=%s,half=%s,shape=straight,waterlogged=false]"


def house(door=DOOR, stairs=STAIRS):
    """5 x 4 x 6 (x, y, z all different, so that swapped axes show)."""
    w, h, l = 5, 4, 6
    b = {(x, y, z): AIR for x in range(w) for y in range(h) for z in range(l)}
    for x in range(w):
        for z in range(l):
            b[x, 0, z] = "minecraft:stone"
            if x in (0, w - 1) or z in (0, l - 1):
                b[x, 1, z] = b[x, 2, z] = "minecraft:stone"
            b[x, 3, z] = "minecraft:stone"
    for z in range(l):  # eaves: upside-down stairs, east side and west side differ
        b[0, 3, z] = stairs % ("east", "top")
        b[w - 1, 3, z] = stairs % ("west", "bottom")
    b[2, 1, 0], b[2, 2, 0] = door % "lower", door % "upper"
    b[4, 1, 5] = "minecraft:gold_block"  # one marker, in no symmetric place
    b[1, 3, 4] = AIR  # a hole in the roof: air on the outside of the box too
    return (w, h, l), b


def states_many():
    """195 valid 1.21.4 states, each with all its properties, short names."""
    s = []
    for name, prop, n in (("cactus", "age", 16), ("sugar_cane", "age", 16), ("kelp", "age", 26),
                          ("weeping_vines", "age", 26), ("twisting_vines", "age", 26), ("composter", "level", 9),
                          ("cake", "bites", 7), ("wheat", "age", 8), ("carrots", "age", 8), ("potatoes", "age", 8),
                          ("beetroots", "age", 4), ("farmland", "moisture", 8)):
        s += [f"minecraft:{name}[{prop}={i}]" for i in range(n)]
    for c in ("white orange magenta light_blue yellow lime pink gray light_gray cyan purple blue brown green red "
              "black").split():
        s += [f"minecraft:{c}_wool", f"minecraft:{c}_concrete"]
    return s


def frame(n_states):
    """20 x 10 x 20, mostly air: the twelve edges of the box, cycling through n_states states, and one diagonal."""
    w, h, l = 20, 10, 20
    pool = states_many()[-n_states:]  # the last ones: wool and concrete are in every frame
    b = {(x, y, z): AIR for x in range(w) for y in range(h) for z in range(l)}
    i = 0
    for y in range(h):
        for z in range(l):
            for x in range(w):
                ends = (x in (0, w - 1)) + (y in (0, h - 1)) + (z in (0, l - 1))
                if ends >= 2 or x == z == 2 * y:
                    b[x, y, z] = pool[i % len(pool)]
                    i += 1
    return (w, h, l), b


HALL = [  # boxes, both corners inclusive, later ones over earlier ones
    (0, 0, 0, 19, 0, 19, "minecraft:stone"),
    (0, 1, 0, 19, 8, 19, "minecraft:stone_bricks"),
    (1, 1, 1, 18, 8, 18, AIR),
    (0, 9, 0, 19, 9, 19, "minecraft:oak_planks"),
    (0, 9, 0, 0, 9, 19, STAIRS % ("east", "top")),
    (19, 9, 0, 19, 9, 19, STAIRS % ("west", "top")),
    (9, 1, 0, 9, 1, 0, DOOR % "lower"),
    (9, 2, 0, 9, 2, 0, DOOR % "upper"),
    (5, 1, 5, 5, 8, 5, "minecraft:oak_log[axis=y]"),
    (14, 1, 5, 14, 8, 5, "minecraft:oak_log[axis=y]"),
    (1, 8, 5, 18, 8, 5, "minecraft:oak_log[axis=x]"),
    (3, 3, 19, 16, 6, 19, "minecraft:glass"),
]


def hall():
    b = {}
    for x1, y1, z1, x2, y2, z2, s in HALL:
        for x in range(x1, x2 + 1):
            for y in range(y1, y2 + 1):
                for z in range(z1, z2 + 1):
                    b[x, y, z] = s
    return (20, 10, 20), b


# ---------------------------------------------------------------- writing
def settle(path):
    """Same bytes every time: gzip again, without a time or a name."""
    path.write_bytes(gzip.compress(gzip.decompress(path.read_bytes()), 9, mtime=0))


def describe(path, info, blocks, fills=None):
    """blocks: dict in the file's own coordinates, air included where the file holds air."""
    solid = {p: canon(s) for p, s in blocks.items() if s != AIR}
    lines = "".join("%d %d %d %s\n" % (*p, solid[p]) for p in sorted(solid))
    doc = dict(file=path.name, **info, block_count=len(solid), air_count=len(blocks) - len(solid),
               sha256_of_lines=hashlib.sha256(lines.encode()).hexdigest())
    if fills is None:
        doc["blocks"] = [dict(x=x, y=y, z=z, block=solid[x, y, z]) for x, y, z in sorted(solid)]
    else:
        doc["fills"] = [dict(from_=f[:3], to=f[3:6], block=canon(f[6])) for f in fills]
        for f in doc["fills"]:
            f["from"] = f.pop("from_")
    head = {k: v for k, v in doc.items() if k not in ("blocks", "fills")}
    key = "fills" if fills is not None else "blocks"
    body = ",\n".join(json.dumps(e, separators=(",", ":")) for e in doc[key])
    text = json.dumps(head, indent=1)[:-2] + f',\n "{key}": [\n{body}\n]}}\n'
    json.loads(text)
    jpath = path.with_name(path.name + ".json")
    jpath.write_text(text)
    for p in (path, jpath):
        size = p.stat().st_size
        print(f"{size:6} {p.name}")
        assert size < 20_000, p


NOTE_NBT = ("structure: blocks are in structure coordinates, 0,0,0 = the least corner (-x,-y,-z) of the box `size`; "
            "the file holds no offset. Cells of the box in neither `blocks` nor air are not in the file (void: "
            "leave what is there).")
NOTE_SCHEM = ("schem: blocks are in schematic coordinates, 0,0,0 = the least corner, index x + z*Width + y*Width*Length. "
              "Where it is pasted: paste point + `offset` + (x,y,z). All other cells of the box are air.")
NOTE_LITE = ("litematic: blocks are in schematic coordinates, relative to the origin of the placement; a region's least "
             "corner is Position, or Position + Size + 1 on an axis whose Size is negative. All other cells of a "
             "region's box are air.")


def info(fmt, ver, size, writer, note, **more):
    return dict(format=fmt, version=ver, data_version=DATA_VERSION, size=list(size), written_by=writer,
                coordinates=note, **more)


def palette_entry(state):
    name, props = split(state)
    c = Compound({"Name": String(name)})
    if props:
        c["Properties"] = Compound({k: String(v) for k, v in props.items()})
    return c


CHEST = "minecraft:chest[facing=north,type=single,waterlogged=false]"


def chest_nbt():
    return Compound({"id": String("minecraft:chest"), "Items": List[Compound]([Compound(
        {"Slot": Byte(0), "id": String("minecraft:stone"), "count": Int(3)})])})


# structure ------------------------------------------------------
def structure_nsu(name, size, blocks):
    nsu.DATAVERSION = DATA_VERSION
    s = nsu.NBTStructure()
    for (x, y, z), st in blocks.items():
        n, props = split(st)
        s.set_block(Vector(x, y, z), BlockData(n, list(props.items())))
    f = s.get_nbt(pressurize=False)
    p = OUT / name
    f.write_file(str(p))
    settle(p)
    return p


def structure_raw(name, size, blocks, palettes=None, be=None):
    states = list(dict.fromkeys(blocks.values()))
    root = nbtlib.File({"DataVersion": Int(DATA_VERSION), "size": List[Int](size), "entities": List[Compound]([])},
                       gzipped=True, root_name="")
    if palettes is None:
        root["palette"] = List[Compound]([palette_entry(s) for s in states])
    else:
        root["palettes"] = List[List[Compound]]([
            List[Compound]([palette_entry(pal.get(s, s)) for s in states]) for pal in palettes])
    out = []
    for p, s in blocks.items():
        c = Compound({"pos": List[Int](p), "state": Int(states.index(s))})
        if be and p in be:
            c["nbt"] = be[p]
        out.append(c)
    root["blocks"] = List[Compound](out)
    path = OUT / name
    root.save(path)
    settle(path)
    return path


def lite_region(pos, size, blocks):
    """blocks: dict in schematic coordinates."""
    r = litemapy.Region(*pos, *size)
    for (x, y, z), s in blocks.items():
        if s != AIR:
            n, props = split(s)
            r[x - pos[0], y - pos[1], z - pos[2]] = litemapy.BlockState(n, **props)
    return r


def make_structures():
    size, b = house()
    p = structure_nsu("house.nbt", size, b)
    describe(p, info("structure", None, size, "nbt-structure-utils 0.3.0", NOTE_NBT), b)

    # void: only the shell and the air inside are in the file; partial states; a chest with nbt; odd order
    size, b = house("minecraft:oak_door[half=%s]", "minecraft:oak_stairs[facing=%s,half=%s]")
    b[2, 1, 3] = CHEST
    b = {p: s for p, s in reversed(b.items()) if s != AIR or (0 < p[0] < 4 and 0 < p[1] < 3 and 0 < p[2] < 5)}
    p = structure_raw("house_void.nbt", size, b, be={(2, 1, 3): chest_nbt()})
    describe(p, info("structure", None, size, "nbtlib 2.0.4", NOTE_NBT,
                     block_entities=[dict(x=2, y=1, z=3, id="minecraft:chest")]), b)

    size, b = house()
    second = {"minecraft:stone": "minecraft:andesite", "minecraft:gold_block": "minecraft:emerald_block"}
    p = structure_raw("house_palettes.nbt", size, b, palettes=[{}, second])
    describe(p, info("structure", None, size, "nbtlib 2.0.4", NOTE_NBT + " Two palettes: `blocks` is by palette 0; "
                     "palette 1 differs as in `palette_1_differs`.", palettes=2, palette_1_differs=second), b)

    size, b = frame(100)
    p = structure_raw("frame.nbt", size, {q: s for q, s in b.items() if s != AIR})
    describe(p, info("structure", None, size, "nbtlib 2.0.4", NOTE_NBT), {q: s for q, s in b.items() if s != AIR})

    size, b = hall()
    r = lite_region((0, 0, 0), size, b)
    p = OUT / "hall.nbt"
    r.to_structure_nbt(mc_version=DATA_VERSION).save(p)
    settle(p)
    describe(p, info("structure", None, size, "litemapy 0.11.0b0", NOTE_NBT), b, fills=HALL)


# schem ----------------------------------------------------------
def schem(name, ver, size, offset, blocks, chest=None, metadata=None):
    s = schempy.Schematic(*size)
    s.data_version, s.offset, s.name, s.author = DATA_VERSION, list(offset), name, "fixtures"
    s.date = datetime.datetime.fromtimestamp(MILLIS / 1000, datetime.timezone.utc)
    s.metadata = metadata or {}
    for (x, y, z), st in blocks.items():
        s.set_block(x, y, z, schempy.Block.from_string(st))
    if chest:
        s.add_block_entity(schempy.Entity("minecraft:chest", *chest, chest_nbt()))
    p = OUT / name
    s.save_to_file(p, version=ver)
    settle(p)
    return p


def mcs(name, least, blocks, fast):
    s = mcschematic.MCSchematic()
    for (x, y, z), st in blocks.items():
        if st != AIR:
            s.setBlock((x + least[0], y + least[1], z + least[2]), st)
    s.save(str(OUT), name[:-6], mcschematic.Version.JE_1_21_4, fast)
    settle(OUT / name)
    return OUT / name


def make_schems():
    size, b = house()
    off = (-3, -1, 2)
    p = schem("house_v3.schem", 3, size, off, b)
    describe(p, info("schem", 3, size, "SchemPy 0.0.12", NOTE_SCHEM, offset=off), b)

    size, b = house("minecraft:oak_door[half=%s]", "minecraft:oak_stairs[facing=%s,half=%s]")
    b[2, 1, 3] = CHEST
    p = schem("house_chest_v3.schem", 3, size, (0, 0, 0), b, chest=(2, 1, 3))
    describe(p, info("schem", 3, size, "SchemPy 0.0.12", NOTE_SCHEM, offset=[0, 0, 0],
                     block_entities=[dict(x=2, y=1, z=3, id="minecraft:chest")]), b)

    size, b = frame(195)
    p = schem("frame_v3.schem", 3, size, (-10, 0, -10), b)
    describe(p, info("schem", 3, size, "SchemPy 0.0.12", NOTE_SCHEM + " More than 128 states: varints of two bytes.",
                     offset=[-10, 0, -10]), b)

    size, b = hall()
    p = schem("hall_v3.schem", 3, size, (-9, -1, 1), b)
    describe(p, info("schem", 3, size, "SchemPy 0.0.12", NOTE_SCHEM, offset=[-9, -1, 1]), b, fills=HALL)

    size, b = house()
    p = schem("house_v2.schem", 2, size, off, b)
    describe(p, info("schem", 2, size, "SchemPy 0.0.12", NOTE_SCHEM, offset=off), b)

    p = schem("house_v2_worldedit.schem", 2, size, (100, 64, -200), b,
              metadata={"WEOffsetX": -3, "WEOffsetY": -1, "WEOffsetZ": 2})
    describe(p, info("schem", 2, size, "SchemPy 0.0.12, as WorldEdit 7 writes v2", NOTE_SCHEM + " `offset` is from "
                     "Metadata WEOffsetX/Y/Z; Offset (100, 64, -200) is where the build stood in the world it was copied "
                     "from.", offset=off), b)

    least = (-7, -3, 4)
    p = mcs("house_v2_weoffset.schem", least, b, False)
    describe(p, info("schem", 2, size, "mcschematic 11.4.4", NOTE_SCHEM + " This file has no Offset: `offset` is from "
                     "Metadata WEOffsetX/Y/Z (the old WorldEdit way).", offset=least), b)

    size, b = frame(195)
    p = mcs("frame_v2_longvarint.schem", (0, 0, 0), b, True)
    describe(p, info("schem", 2, size, "mcschematic 11.4.4, fastSaving", NOTE_SCHEM + " Every varint is two bytes, also "
                     "where one would do (80 00 for 0): readers must take that.", offset=[0, 0, 0]), b)


# litematic ------------------------------------------------------
def litematic(name, regions, ver=(7, 1)):
    s = litemapy.Schematic(name=name, author="fixtures", description="", lm_version=ver[0], lm_subversion=ver[1],
                           mc_version=DATA_VERSION)
    for n, (pos, size, blocks) in regions.items():
        s.regions[n] = lite_region(pos, size, blocks)
    s.created = s.modified = MILLIS
    p = OUT / name
    s.save(str(p), update_meta=False)
    settle(p)
    return p


def lite_info(ver, regions, box, **more):
    return info("litematic", ver, box, "litemapy 0.11.0b0", NOTE_LITE, regions=[dict(
        name=n, position=pos, size=size,
        least=[a if d > 0 else a + d + 1 for a, d in zip(pos, size)]) for n, (pos, size, _) in regions.items()], **more)


def shift(blocks, d):
    return {(x + d[0], y + d[1], z + d[2]): s for (x, y, z), s in blocks.items()}


def make_litematics():
    size, b = house()
    r = {"house": ((0, 0, 0), size, b)}
    p = litematic("house.litematic", r)
    describe(p, lite_info(7, r, size), b)

    # every Size negative: Position is the greatest corner; least corner -6,-4,-3
    nb = shift(b, (-6, -4, -3))
    r = {"house": ((-2, -1, 2), (-5, -4, -6), nb)}
    p = litematic("house_negative.litematic", r)
    describe(p, lite_info(7, r, size), nb)

    # two regions, mixed signs, version 6
    small = {(x, y, z): AIR for x in range(8, 11) for y in range(-2, 0) for z in range(-3, 1)}
    small[8, -2, -3], small[10, -1, 0], small[9, -2, -1] = "minecraft:stone", CHEST, STAIRS % ("east", "top")
    r = {"house": ((-3, -1, 2), size, shift(b, (-3, -1, 2))),
         "small": ((10, -2, -3), (-3, 2, 4), small)}
    both = {**r["house"][2], **small}
    p = litematic("two_regions_v6.litematic", r, (6, 1))
    describe(p, lite_info(6, r, (14, 5, 11)), both)

    size, b = frame(100)
    nb = shift(b, (-10, 0, -10))
    r = {"frame": ((-10, 0, -10), size, nb)}
    p = litematic("frame.litematic", r)
    describe(p, lite_info(7, r, size, remark="101 states: 7 bits an entry, entries span longs"), nb)

    size, b = hall()
    r = {"hall": ((0, 0, 0), size, b)}
    p = litematic("hall.litematic", r)
    describe(p, lite_info(7, r, size, remark="4 bits an entry, 4000 entries"), b, fills=HALL)


if __name__ == "__main__":
    OUT.mkdir(parents=True, exist_ok=True)
    make_structures()
    make_schems()
    make_litematics()
