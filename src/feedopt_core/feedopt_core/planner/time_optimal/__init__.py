"""The methods ``lp``, ``lp_nlp`` and ``oneshot``: windows of minimum time, solved by the own interior point."""
