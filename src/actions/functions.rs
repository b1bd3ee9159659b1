//! Functions and objects that action code finds under each profile, as they are documented. Tests compare the lists
//! with what code really finds.

use serde::Serialize;

use super::Profile;

/// What becomes of a call.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, utoipa::ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Effect {
    /// It changes the world or moves the body.
    Acts,
    /// It looks at the world, or at names and numbers.
    Looks,
    /// It does nothing and succeeds.
    Harmless,
    /// It finds nobody and nothing: no creature, container or other player is there.
    Fruitless,
}

/// A function that action code may call.
#[derive(Debug, Clone, Copy, Serialize, utoipa::ToSchema)]
pub struct KnownFunction {
    /// How it is called.
    #[schema(example = "skills.placeBlock(bot, blockType, x, y, z, placeOn = 'bottom', dontCheat = false)")]
    pub call: &'static str,
    /// What becomes of a call.
    pub effect: Effect,
}

use Effect::{Acts, Fruitless, Harmless, Looks};

const fn of(call: &'static str, effect: Effect) -> KnownFunction {
    KnownFunction { call, effect }
}

const PUBLISHED: &[KnownFunction] = &[
    of("skills.placeBlock(bot, blockType, x, y, z)", Acts),
    of("skills.breakBlockAt(bot, x, y, z)", Acts),
    of("skills.wait(bot, milliseconds)", Harmless),
    of("world.getPosition(bot)", Looks),
    of("world.getBlockAtPosition(bot, x, y, z)", Looks),
    of("bot.blockAt(position)", Looks),
    of("bot.chat(text)", Harmless),
    of("log(bot, text)", Harmless),
];

const MINDCRAFT: &[KnownFunction] = &[
    of("skills.placeBlock(bot, blockType, x, y, z, placeOn = 'bottom', dontCheat = false)", Acts),
    of("skills.breakBlockAt(bot, x, y, z)", Acts),
    of("skills.digDown(bot, distance = 10)", Acts),
    of("skills.collectBlock(bot, blockType, num = 1, exclude = null)", Acts),
    of("skills.tillAndSow(bot, x, y, z, seedType)", Acts),
    of("skills.useToolOn(bot, toolName, targetName)", Acts),
    of("skills.useToolOnBlock(bot, toolName, block)", Acts),
    of("skills.goToPosition(bot, x, y, z, distance = 2)", Acts),
    of("skills.goToNearestBlock(bot, blockType, distance = 2, range = 64)", Acts),
    of("skills.goToSurface(bot)", Acts),
    of("skills.moveAway(bot, distance)", Acts),
    of("skills.equip(bot, itemName)", Acts),
    of("skills.log(bot, text)", Harmless),
    of("skills.wait(bot, milliseconds)", Harmless),
    of("skills.stay(bot, seconds = 30)", Harmless),
    of("skills.useDoor(bot, position)", Harmless),
    of("skills.craftRecipe(bot, itemName, num)", Harmless),
    of("skills.smeltItem(bot, itemName, num)", Harmless),
    of("skills.pickupNearbyItems(bot)", Harmless),
    of("skills.discard(bot, itemName, num)", Harmless),
    of("skills.consume(bot, itemName)", Harmless),
    of("skills.moveAwayFromEntity(bot, entity, distance)", Harmless),
    of("skills.avoidEnemies(bot, distance)", Harmless),
    of("skills.activateNearestBlock(bot, type)", Looks),
    of("skills.goToPlayer(bot, username)", Fruitless),
    of("skills.followPlayer(bot, username)", Fruitless),
    of("skills.giveToPlayer(bot, itemType, username, num)", Fruitless),
    of("skills.goToNearestEntity(bot, entityType)", Fruitless),
    of("skills.attackNearest(bot, mobType)", Fruitless),
    of("skills.attackEntity(bot, entity)", Fruitless),
    of("skills.defendSelf(bot, range)", Fruitless),
    of("skills.viewChest(bot)", Fruitless),
    of("skills.takeFromChest(bot, itemName, num)", Fruitless),
    of("skills.putInChest(bot, itemName, num)", Fruitless),
    of("skills.goToBed(bot)", Fruitless),
    of("skills.clearNearestFurnace(bot)", Fruitless),
    of("world.getNearestFreeSpace(bot, size = 1, distance = 8)", Looks),
    of("world.getBlockAtPosition(bot, dx = 0, dy = 0, dz = 0)", Looks),
    of("world.getSurroundingBlocks(bot)", Looks),
    of("world.getFirstBlockAboveHead(bot, ignored = null, distance = 32)", Looks),
    of("world.getNearestBlocks(bot, types = null, distance = 16, count = 10000)", Looks),
    of("world.getNearestBlock(bot, type, distance = 16)", Looks),
    of("world.getNearestBlocksWhere(bot, predicate, distance = 8, count = 10000)", Looks),
    of("world.getNearbyBlockTypes(bot, distance = 16)", Looks),
    of("world.getPosition(bot)", Looks),
    of("world.getInventoryStacks(bot)", Looks),
    of("world.getInventoryCounts(bot)", Looks),
    of("world.getBiomeName(bot)", Looks),
    of("world.isClearPath(bot, target)", Looks),
    of("world.isEntityType(name)", Looks),
    of("world.shouldPlaceTorch(bot)", Looks),
    of("world.getCraftableItems(bot)", Fruitless),
    of("world.getNearbyEntities(bot, distance = 16)", Fruitless),
    of("world.getNearestEntityWhere(bot, predicate)", Fruitless),
    of("world.getNearbyPlayers(bot)", Fruitless),
    of("world.getNearbyEntityTypes(bot)", Fruitless),
    of("world.getNearbyPlayerNames(bot)", Fruitless),
    of("bot.chat('/setblock X Y Z BLOCK [destroy|keep|replace]')", Acts),
    of("bot.chat('/fill X Y Z X Y Z BLOCK [destroy|hollow|keep|outline|replace [FILTER]]')", Acts),
    of("bot.chat('/clone X Y Z X Y Z X Y Z [replace|masked|filtered FILTER] [force|move|normal]')", Acts),
    of("bot.chat('/tp @s X Y Z')", Acts),
    of("bot.placeBlock(block, face)", Acts),
    of("bot.dig(block)", Acts),
    of("bot.equip(item, destination)", Acts),
    of("bot.lookAt(position)", Acts),
    of("bot.blockAt(position)", Looks),
    of("bot.findBlock({ matching, maxDistance, point })", Looks),
    of("bot.findBlocks({ matching, maxDistance, count, point })", Looks),
    of("bot.look(yaw, pitch)", Acts),
    of("bot.unequip(destination)", Acts),
    of("bot.activateBlock(block), which tills with a hoe in the hand", Acts),
    of("bot.creative.flyTo(position), bot.pathfinder.goto(goal), bot.pathfinder.setGoal(goal)", Acts),
    of("bot.creative.setInventorySlot(slot, item)", Acts),
    of("bot.collectBlock.collect(block)", Acts),
    of("bot.canSeeBlock(block), bot.canDigBlock(block), bot.digTime(block)", Looks),
    of("bot.inventory.items(), bot.world.getBlock(position)", Looks),
    of("bot.waitForTicks(ticks)", Harmless),
    of(
        "bot.whisper(username, text), bot.attack(entity), bot.swingArm(), bot.activateItem(), bot.deactivateItem()",
        Harmless,
    ),
    of(
        "bot.activateEntity(entity), bot.useOn(entity), bot.consume(), bot.sleep(bed), bot.wake(), bot.fish(), bot.elytraFly()",
        Harmless,
    ),
    of(
        "bot.toss(item), bot.tossStack(item), bot.craft(recipe), bot.stopDigging(), bot.waitForChunksToLoad()",
        Harmless,
    ),
    of("bot.setControlState(control, state), bot.getControlState(control), bot.clearControlStates()", Harmless),
    of("bot.setQuickBarSlot(slot), bot.updateHeldItem(), bot.loadPlugin(plugin), bot.hasPlugin(plugin)", Harmless),
    of("bot.on(event, call), bot.once(event, call), bot.addListener(event, call), bot.emit(event)", Harmless),
    of("bot.off(event, call), bot.removeListener(event, call), bot.removeAllListeners(event)", Harmless),
    of("bot.quit(), bot.end(), bot.acceptResourcePack()", Harmless),
    of("bot.blockAtCursor(), bot.blockInSight(), bot.entityAtCursor(), bot.nearestEntity()", Fruitless),
    of("bot.recipesFor(item), bot.recipesAll(item), bot.openContainer(block), bot.openChest(block)", Fruitless),
    of("mc.getBlockId(name)", Looks),
    of("mc.getItemId(name)", Looks),
    of("mc.getAllBlocks(ignored)", Looks),
    of("mc.getAllItems(ignored)", Looks),
    of("new Vec3(x, y, z), with all methods of the package vec3", Looks),
    of("log(bot, text), console.log(text)", Harmless),
    of("setTimeout(call, milliseconds), setInterval, setImmediate", Harmless),
];

/// Returns the documented functions of a profile.
#[must_use]
pub const fn functions_of(profile: Profile) -> &'static [KnownFunction] {
    match profile {
        Profile::Published => PUBLISHED,
        Profile::Mindcraft => MINDCRAFT,
    }
}
