// A script as agents of the mindcraft framework write it: its value is a function that builds.
(async (bot) => {
  for (let y = 0; y < 5; y++) {
    for (let x = 0; x < 5; x++) {
      await skills.placeBlock(bot, 'stone', x, y, 0);
    }
  }
})
