// Names and numbers of blocks and items with the interface of mindcraft's mcdata.js, and a registry as mineflayer's bots
// have one. Called with the host.
(function (host) {
  const once = (make) => { let made; return () => (made ??= make()); };
  const known = (number) => (number < 0 ? null : number);
  const getBlockId = (name) => (typeof name === "string" ? known(host.blockNumber(name)) || (name === "air" ? 0 : null) : null);
  const getItemId = (name) => (typeof name === "string" ? known(host.itemNumber(name)) : null);
  const displayName = (name) => host.itemTitle(name);

  // Kinds of blocks, made when they are first asked for.
  const kinds = new Map();
  const kind = (number) => {
    let found = kinds.get(number);
    if (!found) {
      const [name, hardness, isSolid, isDiggable, isTransparent, hasDrops, first, last, plain, title, stackSize] = host.blockKind(number);
      const item = getItemId(name);
      found = {
        id: number, name, displayName: title, hardness, resistance: hardness, stackSize, diggable: isDiggable,
        transparent: isTransparent, boundingBox: isSolid ? "block" : "empty", minStateId: first, maxStateId: last,
        defaultState: plain, drops: hasDrops && item !== null ? [item] : [], material: "default", emitLight: 0, filterLight: 0,
        states: [],
      };
      kinds.set(number, found);
    }
    return found;
  };
  const itemNames = once(() => host.itemNames());
  const items = once(() => itemNames().map((name, id) => ({ id, name, displayName: displayName(name), stackSize: host.stackSize(name) })));
  const blocks = once(() => Array.from({ length: host.blockCount() }, (_, number) => kind(number)));
  const byName = (list) => once(() => Object.fromEntries(list().map((entry) => [entry.name, entry])));
  const [blocksByName, itemsByName] = [byName(blocks), byName(items)];
  const without = (list, ignored) => list.filter((entry) => !(ignored ?? []).includes(entry.name));

  const registry = {
    get blocks() { return blocks(); },
    get blocksArray() { return blocks(); },
    get blocksByName() { return blocksByName(); },
    get items() { return items(); },
    get itemsArray() { return items(); },
    get itemsByName() { return itemsByName(); },
    biomes: { 0: { id: 0, name: "plains" } },
    biomesByName: { plains: { id: 0, name: "plains" } },
    entitiesByName: {}, recipes: {}, foods: {}, foodsByName: {},
    version: { minecraftVersion: "1.21.4", majorVersion: "1.21", type: "pc" },
  };
  const woods = ["oak", "spruce", "birch", "jungle", "acacia", "dark_oak", "mangrove", "cherry"];
  const colours = [
    "white", "orange", "magenta", "light_blue", "yellow", "lime", "pink", "gray", "light_gray", "cyan", "purple", "blue", "brown",
    "green", "red", "black",
  ];
  const mc = {
    WOOD_TYPES: woods,
    MATCHING_WOOD_BLOCKS: [
      "log", "planks", "sign", "boat", "fence_gate", "door", "fence", "slab", "stairs", "button", "pressure_plate", "trapdoor",
    ],
    WOOL_COLORS: colours,
    getItemId,
    getItemName: (id) => items()[id]?.name ?? null,
    getBlockId,
    getBlockName: (id) => (Number.isInteger(id) && id >= 0 && id < host.blockCount() ? kind(id).name : null),
    getEntityId: () => null,
    getAllItems: (ignored) => without(items(), ignored),
    getAllItemIds: (ignored) => without(items(), ignored).map((item) => item.id),
    getAllBlocks: (ignored) => without(blocks(), ignored),
    getAllBlockIds: (ignored) => without(blocks(), ignored).map((block) => block.id),
    getAllBiomes: () => registry.biomes,
    getItemCraftingRecipes: () => null,
    isHuntable: () => false,
    isHostile: () => false,
    isSmeltable: () => false,
    mustCollectManually: () => false,
    getSmeltingFuel: () => undefined,
    getFuelSmeltOutput: () => 0,
    getItemSmeltingIngredient: () => undefined,
    getItemBlockSources: (name) => (getBlockId(name) === null ? [] : [name]),
    getItemAnimalSource: () => undefined,
    getBlockTool: () => null,
    makeItem: (name, count = 1) => ({ name, count, type: getItemId(name), displayName: displayName(String(name)) }),
  };
  return { mc, registry, kind, displayName };
});
