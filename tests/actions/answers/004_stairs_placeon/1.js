// every placeOn value the docs mention, one unknown value and the default
const sides = ['north', 'south', 'east', 'west', 'top', 'bottom', 'side', 'up'];
let i = 0;
for (const s of sides) {
  await skills.placeBlock(bot, 'oak_stairs', i * 2, 0, 5, s);
  i++;
}
await skills.placeBlock(bot, 'oak_stairs', i * 2, 0, 5);
