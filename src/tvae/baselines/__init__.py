"""Other ways to learn from the same demonstrations, one file a method, all behind the `Policy` of `tvae.rollouts`."""
