// Two tones while an alarm is on that nobody has acknowledged. Browsers allow sound after the first touch of the page.
let context = null, timer = 0;

for (const event of ["pointerdown", "keydown"]) {
  addEventListener(event, () => { context ??= globalThis.AudioContext ? new AudioContext() : null; }, { once: true });
}

function tone(frequency, at) {
  const source = context.createOscillator(), volume = context.createGain();
  source.frequency.value = frequency;
  volume.gain.setValueAtTime(0.2, at);
  volume.gain.exponentialRampToValueAtTime(0.001, at + 0.25);
  source.connect(volume).connect(context.destination);
  source.start(at);
  source.stop(at + 0.26);
}

function call() {
  navigator.vibrate?.([200, 100, 200]);
  if (!context) return;
  tone(880, context.currentTime);
  tone(660, context.currentTime + 0.3);
}

export function sound(on) {
  if (on === Boolean(timer)) return;
  clearInterval(timer);
  timer = 0;
  if (on) {
    call();
    timer = setInterval(call, 2000);
  }
}
