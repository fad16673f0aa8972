"""From demonstrations to a model whose styles are bots: the bound first, then the policy alone."""
