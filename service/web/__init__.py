"""REST and the pages: routes, models, keys, limits."""
