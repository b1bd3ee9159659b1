// The skills of mindcraft (commit 0012750 of 16 June 2025, with goToSurface and useToolOn of later ones) in cheat mode,
// as `docs/rules.md#mindcraft` describes them. They tell only what failed, so that the log keeps room for the code's own
// lines. Called with the host, the bot, the world functions, the data and the clock.
(function (host, log, bot, hold, world, mc, { Vec3, vec3 }, clock) {
  const floor = Math.floor;
  const command = (text) => bot.chat(`/${text}`, true);
  const at = (x, y, z) => `${floor(x)} ${floor(y)} ${floor(z)}`;
  // A text that shows one decimal, as the skills do, which fails for what is no number.
  const shown = (...parts) => {
    if (parts.some((part) => typeof part !== "number")) throw new TypeError("toFixed is not a function of what was given as a coordinate");
    return parts.map((part) => part.toFixed(1)).join(", ");
  };
  const missing = (value) => value === null || value === undefined;

  async function breakBlockAt(bot, x, y, z) {
    if (missing(x) || missing(y) || missing(z)) throw new Error("Invalid position: skills.breakBlockAt lacks a coordinate");
    const block = bot.blockAt(vec3(x, y, z));
    if (!block) throw new TypeError(`skills.breakBlockAt: there is no block at ${x}, ${y}, ${z}`);
    if (block.name === "air" || block.name === "water" || block.name === "lava") {
      log(bot, `Nothing to break at ${shown(x, y, z)}: it is ${block.name}.`);
      return false;
    }
    command(`setblock ${at(x, y, z)} air`);
    return true;
  }

  // The side from which something is attached, turned to where it then faces.
  const opposite = { north: "south", south: "north", east: "west" };
  // The block with the state that the skill asks for.
  function withState(name, placeOn) {
    const face = Object.hasOwn(opposite, placeOn) ? opposite[placeOn] : "east";
    let block = name;
    if (block.includes("torch") && placeOn !== "bottom") {
      block = block.replace("torch", "wall_torch");
      if (placeOn !== "side" && placeOn !== "top") block += `[facing=${face}]`;
    }
    if (block.includes("button") || block === "lever")
      block += placeOn === "top" ? "[face=ceiling]" : placeOn === "bottom" ? "[face=floor]" : `[facing=${face}]`;
    if (block === "ladder" || block === "repeater" || block === "comparator") block += `[facing=${face}]`;
    if (block.includes("stairs")) block += `[facing=${face}]`;
    return block;
  }

  // The blocks that a placement sets, each with its offsets upwards and to the north; null if there is no such block.
  const plans = new Map();
  function planOf(name, placeOn) {
    if (typeof name !== "string" || !mc.getBlockId(name)) return null;
    const block = withState(name, placeOn);
    const plan = [[0, 0, block]];
    if (block.includes("door")) plan.push([1, 0, `${block}[half=upper]`]);
    if (block.includes("bed")) plan.push([0, 1, `${block}[part=head]`]);
    return plan;
  }

  async function placeBlock(bot, blockType, x, y, z, placeOn = "bottom", dontCheat = false) {
    if (!bot?.modes) throw new TypeError("the first argument of skills.placeBlock is not the bot");
    const isCached = typeof blockType === "string" && typeof placeOn === "string";
    const key = isCached ? `${blockType}\n${placeOn}` : null;
    let plan = isCached ? plans.get(key) : planOf(blockType, placeOn);
    if (plan === undefined) {
      plan = planOf(blockType, placeOn);
      plans.set(key, plan);
    }
    if (plan === null && blockType !== "air") {
      host.drop(`${typeof blockType === "string" ? `'${blockType.slice(0, 80)}'` : String(blockType).slice(0, 80)} is not the name of a block${String(blockType).startsWith("minecraft:") ? "; skills take names without minecraft:" : ""}`);
      log(bot, `${blockType} is not a block.`);
      return false;
    }
    if (blockType === "air") return breakBlockAt(bot, x, y, z);
    if (dontCheat) return placeByHand(bot, blockType, x, y, z, placeOn);
    for (const [up, north, block] of plan)
      host.setBlock(floor(x), floor(up ? y + up : y), floor(north ? z - north : z), block);
    return true;
  }

  const free = ["air", "water", "lava", "grass", "short_grass", "tall_grass", "snow", "dead_bush", "fern"];
  const sides = {
    top: vec3(0, 1, 0), bottom: vec3(0, -1, 0), north: vec3(0, 0, -1), south: vec3(0, 0, 1), east: vec3(1, 0, 0), west: vec3(-1, 0, 0),
  };
  // Places as a player does: against a block beside, on the preferred side if there is one.
  async function placeByHand(bot, name, x, y, z, placeOn) {
    const there = vec3(floor(x), floor(y), floor(z));
    const standing = bot.blockAt(there);
    if (!standing) throw new TypeError(`skills.placeBlock: there is no block at ${x}, ${y}, ${z}`);
    if (standing.name === name) {
      log(bot, `${name} is at ${there} already.`);
      return false;
    }
    if (!free.includes(standing.name) && !(await breakBlockAt(bot, x, y, z))) return false;
    const { north, south, east, west } = sides;
    const preferred = placeOn === "side" ? [north, south, east, west] : [sides[placeOn] ?? sides.bottom];
    const all = [...preferred, ...Object.values(sides).filter((side) => !preferred.includes(side))];
    const against = all.find((side) => !free.includes(bot.blockAt(there.plus(side)).name));
    if (!against) {
      log(bot, `Cannot place ${name} at ${there}: nothing is beside it.`);
      return false;
    }
    await hold(name === "redstone_wire" ? "redstone" : name);
    try {
      await bot.placeBlock(bot.blockAt(there.plus(against)), against.scaled(-1));
    } catch (error) {
      log(bot, `Could not place ${name} at ${there}: ${error.message}`);
      return false;
    }
    await clock.wait(200);
    return true;
  }

  async function goToPosition(bot, x, y, z, distance = 2) {
    if (missing(x) || missing(y) || missing(z)) {
      log(bot, `A coordinate is missing: ${x}, ${y}, ${z}`);
      return false;
    }
    command(`tp @s ${x} ${y} ${z}`);
    return true;
  }

  async function goToNearestBlock(bot, blockType, distance = 2, range = 64) {
    const block = world.getNearestBlock(bot, blockType, Math.min(range, 512));
    if (!block) {
      log(bot, `No ${blockType} within ${range} blocks.`);
      return false;
    }
    const { x, y, z } = block.position;
    return goToPosition(bot, x, y, z, distance);
  }

  async function goToSurface(bot) {
    const { x, z } = bot.entity.position;
    const y = host.surface(x, z);
    if (y === null) return false;
    return goToPosition(bot, floor(x), y + 1, floor(z), 0);
  }

  // Moves to the east: which way the pathfinder would choose is open.
  async function moveAway(bot, distance) {
    const { x, y, z } = bot.entity.position;
    const far = floor(x) + Math.ceil(Number(distance) || 0) + 1;
    command(`tp @s ${far} ${floor(y)} ${floor(z)}`);
    return true;
  }

  async function collectBlock(bot, blockType, num = 1, exclude = null) {
    if (num < 1) {
      log(bot, `Cannot collect ${num} blocks.`);
      return false;
    }
    const types = [blockType];
    if (["coal", "diamond", "emerald", "iron", "gold", "lapis_lazuli", "redstone"].includes(blockType)) types.push(`${blockType}_ore`);
    if (blockType.endsWith("ore")) types.push(`deepslate_${blockType}`);
    if (blockType === "dirt") types.push("grass_block");
    let collected = 0;
    for (let tried = 0; tried < num; tried++) {
      const near = world.getNearestBlocks(bot, types, 64, 1 + (exclude?.length ?? 0));
      const isExcluded = ({ position }) => (exclude ?? []).some(({ x, y, z }) => x === position.x && y === position.y && z === position.z);
      const block = near.find((one) => one.diggable && !isExcluded(one));
      if (!block) {
        log(bot, `No more ${blockType} is near.`);
        break;
      }
      try {
        await bot.dig(block);
        collected++;
      } catch (error) {
        log(bot, `Could not collect ${blockType}: ${error}`);
      }
    }
    return collected > 0;
  }

  async function digDown(bot, distance = 10) {
    const start = bot.entity.position.floored();
    const isAir = (block) => block.name === "air" || block.name === "cave_air";
    for (let i = 1; i <= distance; i++) {
      const block = bot.blockAt(start.offset(0, -i, 0));
      const below = [1, 2, 3].map((deeper) => bot.blockAt(start.offset(0, -i - deeper, 0)));
      if ([block, below[0]].some(({ name }) => name === "lava" || name === "water")) {
        log(bot, `Dug ${i - 1} blocks down and met a liquid.`);
        return false;
      }
      if (below.every(isAir)) {
        log(bot, `Dug ${i - 1} blocks down and met a drop.`);
        return false;
      }
      if (!isAir(block)) await breakBlockAt(bot, block.position.x, block.position.y, block.position.z);
    }
    return true;
  }

  async function tillAndSow(bot, x, y, z, seedType = null) {
    [x, y, z] = [Math.round(x), Math.round(y), Math.round(z)];
    if (typeof seedType !== "string") throw new TypeError("skills.tillAndSow: in cheat mode a seed type is needed");
    let plant = seedType;
    for (const ending of ["_seed", "_seeds"]) if (plant.endsWith(ending)) plant = plant.slice(0, -ending.length);
    placeBlock(bot, "farmland", x, y, z);
    placeBlock(bot, plant, x, y + 1, z);
    return true;
  }

  async function useToolOnBlock(bot, toolName, block) {
    const { x, y, z } = block.position;
    await goToPosition(bot, x, y, z, 2);
    await bot.lookAt(block.position.offset(0.5, 0.5, 0.5));
    if (!(await equip(bot, toolName))) return false;
    if (toolName === "water_bucket" || toolName === "lava_bucket") host.pour(toolName, x, y, z);
    else if (toolName === "bucket") host.scoop(x, y, z);
    else if (toolName.endsWith("_hoe")) host.till(x, y, z);
    else host.note(`skills.useToolOn with ${toolName} is not simulated`);
    return true;
  }

  async function useToolOn(bot, toolName, targetName) {
    const target = targetName.toLowerCase();
    if (target === "nothing") return equip(bot, toolName);
    const block = world.getNearestBlock(bot, target, 64);
    if (!block) {
      log(bot, `No ${target} is near.`);
      return false;
    }
    return useToolOnBlock(bot, toolName, block);
  }

  async function equip(bot, itemName) {
    if (mc.getItemId(itemName) === null && itemName !== "hand") {
      log(bot, `There is no item ${itemName}.`);
      return false;
    }
    await hold(itemName);
    return true;
  }

  async function stay(bot, seconds = 30) {
    if (seconds === -1) {
      host.note("skills.stay(bot, -1) never ends, so what follows it in the code was not run");
      return new Promise(() => {});
    }
    await clock.wait(seconds * 1000);
    return true;
  }

  async function wait(bot, milliseconds) {
    await clock.wait(milliseconds);
    return true;
  }

  const nobody = (bot, username) => {
    const player = bot.players[username];
    if (!player) throw new TypeError(`there is no player ${username}`);
    return player;
  };
  // What does nothing to the world, and succeeds.
  const harmless = (name) => ({ [name]: async () => true })[name];
  // What finds nobody: no creature or other player is there.
  const fruitless = (name) => ({ [name]: async () => false })[name];
  // The first argument of every skill is the bot.
  const guarded = (skills) => Object.fromEntries(Object.entries(skills).map(([name, skill]) => {
    if (skill === log || skill === placeBlock) return [name, skill];
    const given = async (bot, ...rest) => {
      if (!bot?.modes) throw new TypeError(`the first argument of skills.${name} is not the bot`);
      return skill(bot, ...rest);
    };
    Object.defineProperty(given, "name", { value: name });
    return [name, given];
  }));
  return guarded({
    log, placeBlock, breakBlockAt, goToPosition, goToNearestBlock, goToSurface, moveAway, collectBlock, digDown, tillAndSow, useToolOn,
    useToolOnBlock, equip, stay, wait,
    goToPlayer: async (bot, username) => { command(`tp @s ${username}`); return true; },
    followPlayer: async (bot, username) => { nobody(bot, username); return true; },
    giveToPlayer: async (bot, itemType, username) => { nobody(bot, username); return false; },
    goToNearestEntity: fruitless("goToNearestEntity"), attackNearest: fruitless("attackNearest"), attackEntity: fruitless("attackEntity"),
    defendSelf: fruitless("defendSelf"), viewChest: fruitless("viewChest"), takeFromChest: fruitless("takeFromChest"),
    putInChest: fruitless("putInChest"), goToBed: fruitless("goToBed"), clearNearestFurnace: fruitless("clearNearestFurnace"),
    moveAwayFromEntity: harmless("moveAwayFromEntity"), avoidEnemies: harmless("avoidEnemies"), useDoor: harmless("useDoor"),
    activateNearestBlock: async (bot, type) => world.getNearestBlock(bot, type, 16) !== null,
    craftRecipe: harmless("craftRecipe"), smeltItem: harmless("smeltItem"), pickupNearbyItems: harmless("pickupNearbyItems"),
    discard: harmless("discard"), consume: harmless("consume"),
  });
});
