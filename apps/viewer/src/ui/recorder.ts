// SPDX-License-Identifier: Apache-2.0
// A film of the canvas, as the browser records it.

const TYPE = 'video/webm';
/** What moves finely everywhere needs more than browsers give by themselves. */
const BITS_PER_SECOND = 16e6;

/** Records the canvas while `work` runs. Throws where the browser has no recorder for WebM. */
export async function record(canvas: HTMLCanvasElement, work: () => Promise<void>): Promise<Blob> {
  if (typeof MediaRecorder === 'undefined' || !MediaRecorder.isTypeSupported(TYPE))
    throw new Error('This browser cannot record WebM (it has no MediaRecorder for it).');
  const stream = canvas.captureStream();
  const recorder = new MediaRecorder(stream, { mimeType: TYPE, videoBitsPerSecond: BITS_PER_SECOND });
  const parts: Blob[] = [];
  const ended = new Promise<void>((resolve, reject) => {
    recorder.ondataavailable = ({ data }) => parts.push(data);
    recorder.onstop = () => resolve();
    recorder.onerror = () => reject(new Error('The browser stopped recording.'));
  });
  recorder.start();
  try {
    await work();
    // the last picture is captured when it is shown
    for (let i = 0; i < 2; ++i) await new Promise(requestAnimationFrame);
  } finally {
    if (recorder.state !== 'inactive') recorder.stop();
    for (const track of stream.getTracks()) track.stop();
  }
  await ended;
  return new Blob(parts, { type: TYPE });
}
