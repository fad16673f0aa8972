"""`tvae reproduce`: the paper's three tasks, its figures, and the numbers behind them, over several seeds."""
