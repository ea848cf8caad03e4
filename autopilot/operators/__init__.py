"""Who moves the order: the skipper at the terminal, routes, patterns, plotters and trials."""
