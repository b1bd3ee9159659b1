await skills.moveAway(bot, 12);
const foe = world.getNearbyEntities(bot, 16).find((entity) => world.isEntityType(entity.name) && entity.name === 'zombie');
if (foe) {
	await skills.attackEntity(bot, foe);
	await skills.moveAwayFromEntity(bot, foe, 8);
}
// coordinates are absolute, so it does not matter where I went
for (let y = 0; y < 2; y++) await skills.placeBlock(bot, 'bricks', -1, y, 0);
