// Writes blocks.txt from the npm package minecraft-assets: see README.md. Run with Node.
import { existsSync, readFileSync, writeFileSync } from "node:fs";
import { createRequire } from "node:module";
import { PNG } from "pngjs";
import data from "minecraft-data";

const VERSION = "1.21.4";
// The pictures of 1.21.4 in the package lack the blocks that came with it.
const PICTURES = "1.21.5";
const require = createRequire(import.meta.url);
const folder = require.resolve("minecraft-assets/package.json").replace("package.json", `minecraft-assets/data/${PICTURES}/`);
const models = require(`${folder}blocks_models.json`);
const states = require(`${folder}blocks_states.json`);

// The game colours these by the biome; these are the colours of plains.
const GRASS = [145, 189, 89], FOLIAGE = [119, 171, 47], WATER = [63, 118, 228];
const TINTS = {
  spruce_leaves: [97, 153, 97], birch_leaves: [128, 167, 85], lily_pad: [32, 128, 48], redstone_wire: [190, 20, 10],
  water: WATER, water_cauldron: WATER, bubble_column: WATER,
  attached_melon_stem: [224, 199, 28], attached_pumpkin_stem: [224, 199, 28],
};
const tintOf = (name) => TINTS[name] ?? (/leaves|vine/.test(name) ? FOLIAGE : /grass|fern|sugar_cane/.test(name) ? GRASS : FOLIAGE);

// The game draws these without a model. Each is given the look of another block, and boxes.
const DYE = "(white|orange|magenta|light_blue|yellow|lime|pink|gray|light_gray|cyan|purple|blue|brown|green|red|black)";
const WITHOUT_MODEL = [
  [new RegExp(`^${DYE}_bed$`), (dye) => `${dye}_wool`, [[0, 3, 0, 16, 9, 16]]],
  [new RegExp(`^${DYE}_banner$`), (dye) => `${dye}_wool`, [[7, 0, 7, 9, 16, 9], [1, 4, 6, 15, 16, 7]]],
  [new RegExp(`^${DYE}_wall_banner$`), (dye) => `${dye}_wool`, [[1, 0, 0, 15, 16, 1]]],
  [/^(.*)_wall_hanging_sign$/, (wood) => `stripped_${wood}_${logOf(wood)}`, [[1, 0, 7, 15, 10, 9]]],
  [/^(.*)_hanging_sign$/, (wood) => `stripped_${wood}_${logOf(wood)}`, [[1, 0, 7, 15, 10, 9]]],
  [/^(.*)_wall_sign$/, (wood) => `${wood}_planks`, [[0, 4, 0, 16, 12, 2]]],
  [/^(.*)_sign$/, (wood) => `${wood}_planks`, [[7, 0, 7, 9, 8, 9], [0, 8, 7, 16, 16, 9]]],
  [/^(trapped_)?chest$/, () => "oak_planks", [[1, 0, 1, 15, 14, 15]]],
  [/^ender_chest$/, () => "obsidian", [[1, 0, 1, 15, 14, 15]]],
  [/^(skeleton)(_wall)?_skull$/, () => "bone_block", [[4, 0, 4, 12, 8, 12]]],
  [/^(wither_skeleton)(_wall)?_skull$/, () => "coal_block", [[4, 0, 4, 12, 8, 12]]],
  [/^(creeper|zombie)(_wall)?_head$/, () => "green_terracotta", [[4, 0, 4, 12, 8, 12]]],
  [/^(player)(_wall)?_head$/, () => "brown_terracotta", [[4, 0, 4, 12, 8, 12]]],
  [/^(piglin)(_wall)?_head$/, () => "pink_terracotta", [[4, 0, 4, 12, 8, 12]]],
  [/^(dragon)(_wall)?_head$/, () => "black_concrete", [[1, 0, 1, 15, 12, 15]]],
  [/^conduit$/, () => "prismarine", [[5, 5, 5, 11, 11, 11]]],
  [/^decorated_pot$/, () => "terracotta", [[1, 0, 1, 15, 16, 15]]],
  [/^water$|^bubble_column$/, () => null, [[0, 0, 0, 16, 14, 16]], WATER],
  [/^lava$/, () => null, [[0, 0, 0, 16, 14, 16]], [212, 90, 18]],
  [/^end_portal$|^end_gateway$/, () => null, [[0, 0, 0, 16, 12, 16]], [12, 24, 36]],
  [/^(moving_piston)$/, () => "piston", [[0, 0, 0, 16, 16, 16]]],
];
const logOf = (wood) => (/crimson|warped/.test(wood) ? "stem" : wood === "bamboo" ? "block" : "log");

const short = (name) => name.replace("minecraft:", "").replace("block/", "").replace("blocks/", "");

// A model with what it has from its parents.
function whole(name) {
  const model = models[short(name)];
  if (!model) return { textures: {}, elements: null };
  const parent = model.parent ? whole(model.parent) : { textures: {}, elements: null };
  return { textures: { ...parent.textures, ...model.textures }, elements: model.elements ?? parent.elements };
}

function texture(textures, reference) {
  let name = textures[reference] ? `#${reference}` : reference;
  for (let depth = 0; name?.startsWith("#") && depth < 10; depth++) name = textures[name.slice(1)];
  return name && !name.startsWith("#") ? short(name) : null;
}

const averages = new Map();
// Mean colour of the part of a texture that is seen, and which share of it that is.
function average(name) {
  if (!averages.has(name)) {
    const file = `${folder}blocks/${name}.png`;
    if (!existsSync(file)) { averages.set(name, null); return null; }
    const { data: pixels } = PNG.sync.read(readFileSync(file));
    const sum = [0, 0, 0];
    let seen = 0;
    for (let at = 0; at < pixels.length; at += 4) {
      const alpha = pixels[at + 3] / 255;
      for (const part of [0, 1, 2]) sum[part] += alpha * pixels[at + part];
      seen += alpha;
    }
    averages.set(name, seen > 0 ? { colour: sum.map((part) => part / seen), share: seen / (pixels.length / 4) } : null);
  }
  return averages.get(name);
}

const area = (from, to, side) => {
  const [dx, dy, dz] = [0, 1, 2].map((axis) => Math.abs(to[axis] - from[axis]));
  return side === "up" || side === "down" ? dx * dz : side === "north" || side === "south" ? dx * dy : dz * dy;
};

// The box of an element in sixteenths of a block. Planes are a sixteenth thick; crossed ones, as of flowers, are a post.
function boxOf(from, to, rotation) {
  const box = [0, 1, 2, 3, 4, 5].map((at) => Math.round(at < 3 ? Math.min(from[at], to[at]) : Math.max(from[at - 3], to[at - 3])));
  const flat = [0, 1, 2].filter((axis) => box[axis] === box[axis + 3]);
  if (flat.length && rotation && Math.abs(rotation.angle) === 45 && rotation.axis === "y") return [5, box[1], 5, 11, box[4], 11];
  for (const axis of flat) box[axis] >= 15 ? (box[axis] = 15, box[axis + 3] = 16) : (box[axis + 3] = box[axis] + 1);
  return box;
}

// A box turned clockwise, seen from above.
function turned([x, y, z, dx, dy, dz], degrees) {
  return degrees === 0 ? [x, y, z, dx, dy, dz] : turned([16 - dz, y, x, 16 - z, dy, dx], degrees - 90);
}

// Mean colours of the top and of the sides of models, and their boxes.
function look(block, names) {
  const sums = { top: [0, 0, 0, 0], side: [0, 0, 0, 0] };
  const boxes = [];
  for (const { model, y: turn = 0 } of names) {
    const { textures, elements } = whole(model);
    for (const { from, to, faces, rotation } of elements ?? []) {
      boxes.push(turned(boxOf(from, to, rotation), turn));
      for (const [side, face] of Object.entries(faces)) {
        const found = average(texture(textures, face.texture));
        if (!found || side === "down") continue;
        const sum = side === "up" ? sums.top : sums.side;
        const weight = Math.max(area(from, to, side), 0.01) * found.share;
        const tint = face.tintindex === undefined ? [255, 255, 255] : tintOf(block);
        for (const part of [0, 1, 2]) sum[part] += (weight * found.colour[part] * tint[part]) / 255;
        sum[3] += weight;
      }
    }
    if (!elements) {
      const found = average(texture(textures, textures.particle ?? "#all"));
      if (found) for (const sum of [sums.top, sums.side]) found.colour.forEach((part, at) => (sum[at] += part)), (sum[3] += 1);
    }
  }
  const mean = (sum) => (sum[3] > 0 ? sum.slice(0, 3).map((part) => Math.round(part / sum[3])) : null);
  const [top, side] = [mean(sums.top), mean(sums.side)];
  return { top: top ?? side, side: side ?? top, boxes };
}

// The models of the default state, each with how it is turned.
function modelsOf(block) {
  const state = states[block.name];
  if (!state) return [];
  const first = (choice) => (Array.isArray(choice) ? choice[0] : choice);
  const wanted = defaults(block);
  const fits = (when) => Object.entries(when).every(([name, values]) => String(values).split("|").includes(wanted[name]));
  if (state.variants) {
    const chosen = Object.entries(state.variants).find(([key]) => key === "" || fits(Object.fromEntries(key.split(",").map((pair) => pair.split("=")))));
    return [first((chosen ?? Object.entries(state.variants)[0])[1])];
  }
  const holds = (when) => !when || (when.OR ? when.OR.some(fits) : when.AND ? when.AND.every(fits) : fits(when));
  const parts = state.multipart.filter(({ when }) => holds(when)).map(({ apply }) => first(apply));
  // Where nothing is joined, such as one pane of glass, any part shows how it looks.
  return parts.length ? parts : [first(state.multipart[0].apply)];
}

function defaults(block) {
  let rest = block.defaultState - block.minStateId;
  const chosen = {};
  for (const state of [...block.states].reverse()) {
    const values = state.values ?? ["true", "false"];
    chosen[state.name] = String(values[rest % values.length]);
    rest = Math.floor(rest / values.length);
  }
  return chosen;
}

const byName = new Map(data(VERSION).blocksArray.map((block) => [block.name, block]));
function lookOf(name) {
  const block = byName.get(name);
  for (const [pattern, like, boxes, colour] of WITHOUT_MODEL) {
    const found = name.match(pattern);
    if (!found) continue;
    if (colour) return { top: colour, side: colour, boxes };
    return { ...lookOf(like(found[1])), boxes };
  }
  return look(name, modelsOf(block));
}

const hex = (colour) => colour.map((part) => part.toString(16).padStart(2, "0")).join("");
const clamp = (box) => box.map((part) => Math.min(Math.max(part, 0), 16));
// At most this many boxes of a block are kept; more are joined into one.
const MOST = 3;
const lines = [];
for (const name of byName.keys()) {
  if (/^(air|cave_air|void_air|barrier|light|structure_void)$/.test(name)) continue;
  const { top, side, boxes: all } = lookOf(name);
  if (!top) throw new Error(`${name} has no colour`);
  let boxes = [...new Set(all.map((box) => clamp(box).join(",")))].map((box) => box.split(",").map(Number));
  if (boxes.length > MOST) boxes = [[0, 1, 2, 3, 4, 5].map((at) => (at < 3 ? Math.min : Math.max)(...boxes.map((box) => box[at])))];
  const shown = boxes.map((box) => box.join(",")).filter((box) => box !== "0,0,0,16,16,16");
  lines.push([name, hex(top), hex(side), ...(boxes.some((box) => box.join() === "0,0,0,16,16,16") ? [] : shown)].join(" "));
}
writeFileSync(new URL("blocks.txt", import.meta.url), lines.join("\n") + "\n");
