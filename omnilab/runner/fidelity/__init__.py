"""What the publications behind the recipes claim, measured: `omnilab fidelity`."""
