bot.chat('/fill 0 -1 2 2 -1 2 cobblestone')
