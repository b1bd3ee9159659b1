// The world functions of mindcraft (commit 0012750). Called with the host and the data of the game.
(function (host, mc) {
  const air = { name: "air" };
  const around = (bot, x, y, z) => bot.blockAt(bot.entity.position.offset(x, y, z)) ?? air;
  const getNearestBlocks = (bot, types = null, distance = 16, count = 10000) => {
    const names = types === null ? null : Array.isArray(types) ? types : [types];
    const ids = names === null ? mc.getAllBlockIds(["air"]) : names.map((name) => mc.getBlockId(name)).filter((id) => id !== null);
    const found = bot.findBlocks({ matching: ids, maxDistance: distance, count });
    const { position } = bot.entity;
    const near = found.map((at) => ({ block: bot.blockAt(at), distance: at.distanceTo(position) }));
    return near.sort((a, b) => a.distance - b.distance).map(({ block }) => block);
  };
  const getNearestBlock = (bot, type, distance = 16) => getNearestBlocks(bot, type, distance, 1)[0] ?? null;
  const getNearestBlocksWhere = (bot, predicate, distance = 8, count = 10000) =>
    bot.findBlocks({ matching: predicate, maxDistance: distance, count }).map((at) => bot.blockAt(at));
  return {
    getNearestFreeSpace(bot, size = 1, distance = 8) {
      const empty = bot.findBlocks({ matching: mc.getBlockId("air"), maxDistance: distance, count: 1000 });
      const isFree = (at) => {
        for (let x = 0; x < size; x++)
          for (let z = 0; z < size; z++) {
            const below = bot.blockAt(at.offset(x, -1, z));
            if (!bot.blockAt(at.offset(x, 0, z)) || !below || below.drops.length === 0 || !below.diggable) return false;
          }
        return true;
      };
      return empty.find(isFree);
    },
    getBlockAtPosition: (bot, x = 0, y = 0, z = 0) => around(bot, x, y, z),
    getSurroundingBlocks: (bot) => [
      `Block Below: ${around(bot, 0, -1, 0).name}`, `Block at Legs: ${around(bot, 0, 0, 0).name}`, `Block at Head: ${around(bot, 0, 1, 0).name}`,
    ],
    getFirstBlockAboveHead(bot, ignored = null, distance = 32) {
      const passed = ignored === null ? ["air", "cave_air"] : (Array.isArray(ignored) ? ignored : [ignored]).filter((name) => mc.getBlockId(name));
      for (let i = 0; i < distance; i++) {
        const { name } = around(bot, 0, i + 2, 0);
        if (!passed.includes(name)) return `${name} (${i} blocks up)`;
      }
      return passed.includes("air") ? "none" : "air (0 blocks up)";
    },
    getNearestBlocks, getNearestBlock, getNearestBlocksWhere,
    getNearbyEntities: (bot, distance = 16) => Object.values(bot.entities).filter(({ position }) => position.distanceTo(bot.entity.position) <= distance),
    getNearestEntityWhere: () => null,
    getNearbyPlayers: () => [],
    getInventoryStacks: (bot) => bot.inventory.items(),
    getInventoryCounts: (bot) => Object.fromEntries(bot.inventory.items().map(({ name, count }) => [name, count])),
    getCraftableItems: () => [],
    getPosition: (bot) => bot.entity.position,
    getNearbyEntityTypes: () => [],
    isEntityType: () => false,
    getNearbyPlayerNames: () => [],
    getNearbyBlockTypes(bot, distance = 16) {
      const { x, y, z } = bot.entity.position;
      return host.kindsWithin(Math.floor(x), Math.floor(y), Math.floor(z), distance).map((id) => mc.getBlockName(id));
    },
    isClearPath: async () => true,
    shouldPlaceTorch: () => false,
    getBiomeName: () => "plains",
  };
});
