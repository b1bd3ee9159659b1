await bot.setBlock(new Vec3(1, 0, 1), 'stone');
