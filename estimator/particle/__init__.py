"""The paper's particle filter: Rao-Blackwellized, with stochastic volatility and a gated kernel."""
