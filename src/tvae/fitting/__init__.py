"""From demonstrations to a model whose styles are bots: the bound first, then the policy alone."""

MOST_POLICY_STEPS = 2_500
"""Of the policy alone, where nothing else is asked: it then takes as many as the training before, but no more."""
