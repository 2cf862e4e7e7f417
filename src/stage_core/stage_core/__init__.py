"""Words that all packages share: quantities, frames, clocks, parameters, twin files, sessions."""
