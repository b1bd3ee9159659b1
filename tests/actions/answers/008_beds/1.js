await skills.placeBlock(bot, "red_bed", 3, 0, 3)
await skills.placeBlock(bot, "white_bed", 6, 0, 0, "east")
await skills.placeBlock(bot, "bed", 9, 0, 0)
