// Hoe one given block, not the nearest one.
const target = bot.blockAt(new Vec3(3, -1, 1));
await skills.useToolOnBlock(bot, 'diamond_hoe', target);
await skills.placeBlock(bot, 'wheat', 3, 0, 1);
