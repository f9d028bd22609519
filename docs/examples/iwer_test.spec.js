// A round of a simulated user in a page's own tests, with Playwright and IWER.
// The player runs in real time: poll for the state instead of waiting for a time.
// Headless Chromium needs WebGL: --use-angle=swiftshader without a GPU.
import { test, expect } from '@playwright/test';
import { readFileSync } from 'node:fs';

const recording = JSON.parse(readFileSync('tests/fixtures/round.json', 'utf8'));

test('a simulated user presses a button', async ({ page }) => {
  await page.addInitScript({ path: 'node_modules/iwer/build/iwer.js' });
  await page.addInitScript(() => {
    window.device = new IWER.XRDevice(IWER.metaQuest3);
    // Chromium has a WebXR of its own, without a headset.
    window.device.installRuntime({ forceInstall: true });
  });
  await page.goto('http://localhost:8080/index.html');
  await page.getByRole('button', { name: /enter vr/i }).click();
  await page.waitForFunction(() => window.device.activeSession);
  await page.evaluate(async (recording) => {
    const space = await window.device.activeSession.requestReferenceSpace('local-floor');
    window.device.createActionPlayer(space, recording).play();
  }, recording);
  await expect.poll(() => page.evaluate(() => app.pressed), { timeout: 60_000 }).toBeGreaterThan(0);
});
