//! What will be modelled and what it costs.
