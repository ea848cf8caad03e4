// The tones of the alarm that is on: three and a pause for an alarm, two for a warning. Browsers allow sound after the first touch.
const TONE_S = 0.18, GAP_S = 0.3;
let context = null, timer = 0, playing = "";

for (const event of ["pointerdown", "keydown"]) {
  addEventListener(event, () => { context ??= globalThis.AudioContext ? new AudioContext() : null; }, { once: true });
}

function tone(frequency, at) {
  const source = context.createOscillator(), volume = context.createGain();
  source.frequency.value = frequency;
  volume.gain.setValueAtTime(0.25, at);
  volume.gain.exponentialRampToValueAtTime(0.001, at + TONE_S);
  source.connect(volume).connect(context.destination);
  source.start(at);
  source.stop(at + TONE_S + 0.01);
}

function call(tones) {
  if (navigator.userActivation?.hasBeenActive) navigator.vibrate?.(Array.from({ length: 2 * tones - 1 }, (_, place) => place % 2 ? 120 : 180));
  if (!context) return;
  for (let place = 0; place < tones; place += 1) tone(tones > 2 ? 880 : 660, context.currentTime + GAP_S * place);
}

/* wanted: [how many tones, every so many seconds], null for silence */
export function sound(wanted) {
  const key = JSON.stringify(wanted ?? null);
  if (key === playing) return;
  playing = key;
  clearInterval(timer);
  if (!wanted) return;
  const [tones, every] = wanted;
  call(tones);
  timer = setInterval(call, every * 1000, tones);
}
