"""The shell around the core: clocks, the fixed-rate cycle, the recorder."""
