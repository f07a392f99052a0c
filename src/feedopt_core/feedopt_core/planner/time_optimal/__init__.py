"""The methods ``lp``, ``lp_nlp`` and ``oneshot``: time-optimal windows by our own interior point."""
