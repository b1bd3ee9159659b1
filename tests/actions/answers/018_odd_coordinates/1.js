await skills.placeBlock(bot, 'stone', null, 0, 5);        // null counts as 0
await skills.placeBlock(bot, 'stone', "3", "0", "5");
await skills.placeBlock(bot, 'stone', -0.5, 0.9, 5.2);
await skills.placeBlock(bot, 'stone', undefined, 0, 5);
await skills.placeBlock(bot, 'stone', 'four', 0, 5);
await skills.placeBlock(bot, 'stone', {x: 6, y: 0, z: 5});
await skills.placeBlock(bot, 'stone', [7, 0, 5]);
await skills.placeBlock(bot, 'stone', 1.999, 1, 5);
