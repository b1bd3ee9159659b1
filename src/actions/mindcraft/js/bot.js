// The bot with the interface of mineflayer 4.29: a body, its inventory, and its view of the world. Called with the host,
// what takes notes, the vectors, the data of the game and the clock.
(function (host, note, log, { Vec3, vec3 }, { registry, kind, displayName, mc }, clock) {
  const position = new Vec3(...host.position());
  const entity = {
    position, velocity: new Vec3(0, 0, 0), yaw: 0, pitch: 0, height: 1.62, width: 0.6, onGround: true, id: 1, type: "player",
    name: "player", username: "builder", metadata: [], effects: {},
  };
  // Angles here are in radians, and 0 is north; those of the game are in degrees, and 0 is south.
  const seen = () => { const [yaw, pitch] = host.view(); entity.yaw = ((180 - yaw) * Math.PI) / 180; entity.pitch = (-pitch * Math.PI) / 180; };
  seen();

  // What is known of a block state, kept by its number.
  const states = new Map();
  const blockLike = {
    canHarvest() { return true; },
    digTime() { return 0; },
    getProperties() { return { ...this._properties }; },
  };
  const stateOf = (number) => {
    let found = states.get(number);
    if (!found) {
      const [block, properties] = host.state(number);
      const { id, name, hardness, diggable, boundingBox, transparent, drops, minStateId } = kind(block);
      found = Object.assign(Object.create(blockLike), {
        type: id, name, displayName: displayName(name), stateId: number, metadata: number - minStateId, hardness, diggable,
        boundingBox, transparent, drops, material: "default", light: 0, skyLight: 15, biome: { id: 0, name: "plains" },
        _properties: Object.fromEntries(properties.map(([key, value]) =>
          [key, value === "true" ? true : value === "false" ? false : /^\d+$/.test(value) ? Number(value) : value])),
        shapes: boundingBox === "block" ? [[0, 0, 0, 1, 1, 1]] : [],
      });
      states.set(number, found);
    }
    return found;
  };
  const made = (number, at) => {
    const block = Object.create(stateOf(number));
    block.position = at;
    return block;
  };
  const blockAt = (at) => {
    const number = at ? host.block(Number(at.x), Number(at.y), Number(at.z)) : -1;
    return number < 0 ? null : made(number, new Vec3(Math.floor(at.x), Math.floor(at.y), Math.floor(at.z)));
  };

  const moved = () => { const [x, y, z] = host.position(); position.set(x, y, z); seen(); };
  const send = (line) => {
    if (!line.startsWith("/")) return;
    host.command(line.slice(1));
    if (line.startsWith("/t") || line.startsWith("/execute") || line.startsWith("/minecraft:t")) moved();
  };
  // The skills give their commands through here too, and say so: `published` has functions of its own for them.
  const chat = (message, isOfSkill = false) => {
    if (typeof message !== "string" && typeof message !== "number") throw new TypeError("bot.chat takes a text");
    const lines = String(message).split("\n").filter((line) => line);
    if (lines.length > 1) note("bot.chat got several lines, for which a server ends the connection; each was sent on its own");
    const before = host.changes();
    const isMeant = (line) => ["setblock ", "fill ", "clone ", "/"].some((word) => line.trimStart().startsWith(word));
    for (const line of lines) {
      if (!line.startsWith("/") && isMeant(line)) note(`bot.chat: a command begins with /; this was said, and did nothing: ${line.slice(0, 80)}`);
      send(line);
    }
    if (!isOfSkill && host.changes() > before) note("a command of bot.chat built: under published it would have no effect");
  };

  const findBlocks = (options) => {
    const { matching, useExtraInfo } = options;
    const point = options.point || position;
    const [maxDistance, count] = [Number(options.maxDistance) || 16, Number(options.count) || 1];
    const from = [Number(point.x), Number(point.y), Number(point.z)];
    const find = (most, kinds) => {
      const flat = host.find(...from, maxDistance, most, kinds);
      const found = [];
      for (let i = 0; i < flat.length; i += 3) found.push(new Vec3(flat[i], flat[i + 1], flat[i + 2]));
      return found;
    };
    if (typeof matching !== "function" && typeof useExtraInfo !== "function") {
      const ids = (Array.isArray(matching) ? matching : [matching]).filter((id) => Number.isInteger(id) && id >= 0);
      return find(count, ids);
    }
    const ids = typeof matching === "function" ? null : Array.isArray(matching) ? matching : [matching];
    const accepts = (block) => (ids ? ids.includes(block.type) : matching(block)) && (typeof useExtraInfo !== "function" || useExtraInfo(block));
    // A function is asked about every state that is there. What it says of a block without a place does not count if it
    // asked for the place; then it is asked about each block of that state.
    const mayAccept = (state) => {
      const block = made(state, null);
      let isAsked = false;
      Object.defineProperty(block, "position", { get() { isAsked = true; return new Vec3(...from); } });
      try { return accepts(block) || isAsked; } catch { return true; }
    };
    const kinds = [...new Set(host.statesAround().filter(mayAccept).map((state) => stateOf(state).type))];
    const found = [];
    for (const at of find(100_000, kinds)) {
      if (found.length >= count) break;
      if (accepts(blockAt(at))) found.push(at);
    }
    return found;
  };

  const item = (name, count = 64, slot = 36) =>
    ({ name, count, slot, type: mc.getItemId(name), displayName: displayName(name), stackSize: host.stackSize(name), metadata: 0, nbt: null });
  // The host keeps what is held, for the next file.
  let shown = { name: "", item: null };
  const held = () => {
    const name = host.held();
    if (shown.name !== name) shown = { name, item: name ? item(name) : null };
    return shown.item;
  };
  let stock = null;
  // Creative: enough of everything.
  const items = () => (stock ??= registry.itemsArray.filter(({ name }) => name !== "air").map(({ name }, at) => item(name, 64, 9 + at)));
  const inventory = {
    items,
    get slots() { return items(); },
    count: () => 64,
    emptySlotCount: () => 0,
    findInventoryItem: (what) => items().find(({ name, type }) => name === what || type === what) ?? null,
  };
  const hold = async (what) => {
    const name = typeof what === "string" ? what : typeof what === "number" ? mc.getItemName(what) : what?.name;
    host.hold(name && mc.getItemId(name) !== null ? name : "");
  };
  const look = (at) => {
    const [dx, dy, dz] = [at.x - position.x, at.y - (position.y + entity.height), at.z - position.z];
    entity.yaw = Math.atan2(-dx, -dz);
    entity.pitch = Math.atan2(dy, Math.hypot(dx, dz));
    host.look(180 - (entity.yaw * 180) / Math.PI, (-entity.pitch * 180) / Math.PI);
  };
  const lookAt = async (at) => look(at);
  const placeBlock = async (reference, face) => {
    if (!held()) throw new Error("must be holding an item to place");
    if (!reference?.position || !face) throw new TypeError("bot.placeBlock needs a block to place against and a face vector");
    const { x, y, z } = reference.position;
    look(new Vec3(x + 0.5 + face.x / 2, y + 0.5 + face.y / 2, z + 0.5 + face.z / 2));
    const refusal = host.placeByHand(x, y, z, face.x, face.y, face.z, host.held());
    if (refusal) throw new Error(refusal);
  };
  const dig = async (block) => {
    if (!block?.position) throw new TypeError("bot.dig needs a block");
    if (block.diggable === false) throw new Error(`${block.name} cannot be dug`);
    host.dig(block.position.x, block.position.y, block.position.z);
  };
  const goThere = async (goal) => {
    if (goal && [goal.x, goal.y, goal.z].every(Number.isFinite)) { host.moveTo(goal.x + 0.5, goal.y, goal.z + 0.5); moved(); }
  };
  const activateItem = async () => {
    note(`bot.activateItem with ${host.held() || "nothing"} is not simulated`);
  };
  const nothing = () => {};
  // Events that a real bot has all the time happen once, a tick later; others never do.
  const ticking = ["physicsTick", "physicTick", "move", "time", "health", "spawn", "chunkColumnLoad"];
  const once = (event, call) => {
    if (ticking.includes(event)) clock.wait(50).then(() => call());
    else note(`bot.once("${String(event)}") never happens here`);
  };
  const on = (event) => note(`bot.on("${String(event)}") never happens here`);
  const done = async () => {};
  const modes = { isOn: (mode) => mode === "cheat", exists: () => true, setOn: nothing, pause: nothing, unpause: nothing, unPauseAll: nothing };
  const bot = {
    entity, inventory, registry, modes, username: "builder", version: "1.21.4", majorVersion: "1.21", output: "", interrupt_code: false,
    restrict_to_inventory: false, health: 20, food: 20, foodSaturation: 5, oxygenLevel: 20, isSleeping: false, isRaining: false,
    quickBarSlot: 0, players: { builder: { username: "builder", entity } }, entities: { 1: entity }, player: { username: "builder", entity },
    game: { gameMode: "creative", dimension: "overworld", difficulty: "peaceful", levelType: "flat", minY: -64, height: 384 },
    time: { timeOfDay: 1000, day: 0, isDay: true, age: 1000, time: 1000, bigTime: 1000n, moonPhase: 0 },
    experience: { level: 0, points: 0, progress: 0 }, spawnPoint: new Vec3(0, 0, 0), controlState: {}, physics: { gravity: 0.08 },
    get heldItem() { return held(); },
    chat, whisper: nothing, blockAt, findBlocks,
    findBlock: (options) => { const [at] = findBlocks({ ...options, count: 1 }); return at ? blockAt(at) : null; },
    canSeeBlock: () => true, canDigBlock: () => true, blockAtCursor: () => null, blockInSight: () => null, entityAtCursor: () => null,
    nearestEntity: () => null, world: {
      getBlock: blockAt, getBiome: () => 0,
      getBlockType: (at) => blockAt(at)?.type, getBlockStateId: (at) => blockAt(at)?.stateId,
    },
    placeBlock, _placeBlockWithOptions: placeBlock, dig, stopDigging: nothing, digTime: () => 0, lookAt, targetDigBlock: null,
    look: async (yaw, pitch) => { entity.yaw = yaw; entity.pitch = pitch; host.look(180 - (yaw * 180) / Math.PI, (-pitch * 180) / Math.PI); },
    equip: hold, unequip: async () => { host.hold(""); }, setQuickBarSlot: nothing, updateHeldItem: nothing,
    creative: {
      setInventorySlot: async (slot, what) => { if (what) await hold(what); }, clearInventory: done, clearSlot: done,
      flyTo: async (to) => { host.moveTo(to.x, to.y, to.z); moved(); }, startFlying: nothing, stopFlying: nothing,
    },
    activateBlock: async (block) => { if (block?.position && host.held().endsWith("_hoe")) host.till(block.position.x, block.position.y, block.position.z); },
    activateItem, useOn: done, deactivateItem: nothing, activateEntity: done, attack: nothing, swingArm: nothing, consume: done, sleep: done, wake: done,
    toss: done, tossStack: done, craft: done, recipesFor: () => [], recipesAll: () => [], fish: done, elytraFly: done,
    setControlState: () => note("the body does not walk by bot.setControlState"), getControlState: () => false, clearControlStates: nothing, waitForTicks: (ticks) => clock.wait(ticks * 50),
    waitForChunksToLoad: done, on, addListener: on, once, off: nothing, emit: nothing, removeListener: nothing, removeAllListeners: nothing,
    loadPlugin: nothing, hasPlugin: () => true, quit: nothing, end: nothing, acceptResourcePack: nothing,
    openContainer: async () => { throw new Error("containers are not simulated"); },
    openChest: async () => { throw new Error("containers are not simulated"); },
    pathfinder: {
      setMovements: nothing, setGoal: goThere, goto: goThere, stop: nothing, isMoving: () => false, isMining: () => false,
      isBuilding: () => false, getPathTo: () => ({ status: "success", path: [] }), thinkTimeout: 5000, movements: {}, goal: null,
    },
    tool: { equipForBlock: done }, pvp: { attack: nothing, stop: nothing }, armorManager: { equipAll: done }, autoEat: { eat: done, options: {} },
    collectBlock: { collect: async (block) => { for (const one of Array.isArray(block) ? block : [block]) await dig(one); } },
    moved,
  };
  Object.defineProperty(bot, "moved", { enumerable: false });
  return { bot, hold, vec3 };
});
