"""Student policies: distillation by DAgger."""
