await bot.equip(mc.getItemId('stone'), 'hand');
await bot.lookAt(new Vec3(5, 1, 0));
await bot.waitForTicks(20);
const near = world.getNearestBlocksWhere(bot, (block) => block.name === 'grass_block', 3, 5);
log(bot, `${near.length} near, clear: ${await world.isClearPath(bot, { position: new Vec3(4, 0, 0) })}`);
const under = bot.blockAt(new Vec3(2, -1, 0));
await bot.placeBlock(under, new Vec3(0, 1, 0));
await bot.dig(bot.blockAt(new Vec3(4, -1, 0)));
