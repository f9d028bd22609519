"""WebXR pages in lockstep: a headless browser, a device and a clock of our own."""
