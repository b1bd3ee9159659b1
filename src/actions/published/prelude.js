// Stand-ins for what action code is given (`docs/rules.md#formats`). Called with the recording function and the clock.
(function (record, clock) {
  "use strict";
  // May be called without `new`, as in the game's own library.
  function Vec3(x, y, z) {
    if (!new.target) return new Vec3(x, y, z);
    this.x = x; this.y = y; this.z = z;
  }
  const methods = {
    floored() { return new Vec3(Math.floor(this.x), Math.floor(this.y), Math.floor(this.z)); },
    floor() { this.x = Math.floor(this.x); this.y = Math.floor(this.y); this.z = Math.floor(this.z); return this; },
    clone() { return new Vec3(this.x, this.y, this.z); },
    offset(dx, dy, dz) { return new Vec3(this.x + dx, this.y + dy, this.z + dz); },
    distanceTo(other) { return Math.hypot(other.x - this.x, other.y - this.y, other.z - this.z); },
  };
  for (const [name, value] of Object.entries(methods))
    Object.defineProperty(Vec3.prototype, name, { value, writable: true, configurable: true });
  const air = () => ({ name: "air", type: 0 });

  const position = new Vec3(0, 0, 0);
  const silent = () => {};
  const given = {
    Vec3,
    skills: {
      placeBlock: async (bot, name, x, y, z) => { record(true, name, x, y, z); },
      breakBlockAt: async (bot, x, y, z) => { record(false, undefined, x, y, z); },
      wait: (bot, ms) => clock.wait(ms),
    },
    world: { getPosition: () => position, getBlockAtPosition: air },
    bot: {
      entity: { position },
      interrupt_code: false,
      registry: { blocks: { 0: { name: "air" } } },
      blockAt: air,
      chat: silent,
    },
    log: silent,
    console: { log: silent, info: silent, warn: silent, error: silent, debug: silent },
    module: { exports: {} },
  };
  for (const [name, value] of Object.entries(given)) globalThis[name] = value;
  globalThis.exports = given.module.exports;
  return { bot: given.bot, module: given.module };
});
