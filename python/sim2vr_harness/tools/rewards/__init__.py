"""What each part of a reward is worth over a movement, beside the effort that it costs."""
