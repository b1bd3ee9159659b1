// Puts the profile together: the global names that code finds. Called with the host and the parts.
(function (host, clock, parts) {
  // Texts that go to the host must be well-formed.
  const wellFormed = String.prototype.toWellFormed;
  const clean = (value) => (typeof value === "string" ? wellFormed.call(value) : value);
  for (const name of ["note", "drop", "log", "missing", "command", "setBlock", "blockNumber", "itemNumber", "placeByHand", "pour", "hold", "itemTitle", "stackSize"]) {
    const call = host[name];
    host[name] = (...args) => call(...args.map(clean));
  }
  const note = (text) => host.note(text);
  const shown = (value) => {
    if (typeof value === "string") return value;
    if (value instanceof Error) return `${value.name}: ${value.message}`;
    if (value instanceof Vec3) return String(value);
    try { return (typeof value === "object" && value !== null ? JSON.stringify(value) : undefined) ?? String(value); } catch { return Object.prototype.toString.call(value); }
  };
  const print = (...values) => host.log(values.map(shown).join(" "));
  // What mindcraft's log takes is the bot and one message.
  const log = (bot, ...message) => {
    if (bot === null || (typeof bot !== "object" && typeof bot !== "function"))
      throw new TypeError(`the first argument of log is the bot, not ${shown(bot)}`);
    print(...message);
  };
  const { Vec3, vec3 } = parts.vec3(note);
  const data = parts.data(host);
  const { bot, hold } = parts.bot(host, note, log, { Vec3, vec3 }, data, clock);
  const world = parts.world(host, data.mc);
  const skills = parts.skills(host, log, bot, hold, world, data.mc, { Vec3, vec3 }, clock);

  // Names that do not exist are told, whatever the code does then.
  const told = new Set();
  const watched = (name, of) => new Proxy(of, {
    get(target, key) {
      if (key in target || typeof key === "symbol" || key === "then" || key === "toJSON" || key === "default") return target[key];
      const path = `${name}.${key}`;
      host.missing(name, key, told.has(path) ? "" : Object.keys(target).join());
      told.add(path);
      return undefined;
    },
  });
  const pathfinder = {
    pathfinder: () => {}, Movements: class Movements {},
    goals: Object.fromEntries(["GoalNear", "GoalBlock", "GoalGetToBlock", "GoalLookAtBlock", "GoalXZ", "GoalNearXZ", "GoalY", "GoalFollow", "GoalInvert"].map((name) =>
      [name, class { constructor(x, y, z, range) { Object.assign(this, typeof x === "number" ? { x, y, z, range } : {}); } }])),
  };
  const given = {
    Vec3, log, bot: watched("bot", bot), skills: watched("skills", skills), world: watched("world", world), mc: watched("mc", data.mc),
    console: Object.fromEntries(["log", "info", "warn", "error", "debug", "trace"].map((name) => [name, print])),
    module: { exports: {} },
  };
  // Modules that exist, by the end of their names.
  const modules = {
    vec3, skills: given.skills, world: given.world, mcdata: given.mc, "minecraft-data": () => data.registry, "prismarine-registry": () => data.registry,
    "mineflayer-pathfinder": pathfinder, mineflayer: { createBot: () => given.bot },
  };
  const find = (name) => {
    const short = String(name).split("/").pop().replace(/\.(m?js|ts)$/, "");
    if (!Object.hasOwn(modules, short)) throw new Error(`cannot find module '${name}': there are ${Object.keys(modules).join(", ")}`);
    return modules[short];
  };
  given.require = (name) => { note("require does not exist in mindcraft"); return find(name); };
  for (const name of ["setTimeout", "setInterval", "setImmediate"]) {
    const timer = globalThis[name];
    globalThis[name] = (...args) => { note(`${name} does not exist in mindcraft; here it waits virtual time`); return timer(...args); };
  }
  for (const [name, value] of Object.entries(given)) globalThis[name] = value;
  globalThis.exports = given.module.exports;

  const mainOf = (value) => {
    if (typeof value === "function") return value;
    if (typeof value !== "object" || value === null) return null;
    return [value.default, value.main].find((one) => typeof one === "function") ?? null;
  };
  // Rejections that nobody handles are told by the engine.
  let isCalled = false;
  const run = async (make, isExpression, isWrapped) => {
    const value = await make(given.bot);
    const main = isExpression ? mainOf(value) : null;
    if (main) {
      isCalled = true;
      if (!isWrapped) note("the code is a function, which mindcraft would not call; it was called");
      await main.call(value, given.bot);
    }
    host.done();
  };
  const runModule = async (evaluated, exported) => {
    await evaluated;
    const main = mainOf(exported.default) ?? mainOf(exported);
    if (main) {
      isCalled = true;
      await main(given.bot);
    }
    host.done();
  };
  const callUnused = (value) => {
    const main = mainOf(value);
    if (!main) return false;
    isCalled = true;
    note("the code only defines a function, which mindcraft would not call; it was called");
    (async () => { await main.call(value, given.bot); host.done(); })();
    return true;
  };
  // Begins a file: the time and the body are where the last one left them.
  const wasCalled = () => isCalled;
  const begin = (now) => { clock.begin(now); bot.moved(); };
  return { bot: given.bot, module: given.module, find, begin, run, runModule, callUnused, wasCalled };
});
