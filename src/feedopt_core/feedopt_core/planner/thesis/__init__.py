"""The method ``thesis``: CasADi, sequential quadratic programming on OSQP, and IPOPT."""
