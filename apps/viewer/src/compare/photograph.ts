// SPDX-License-Identifier: Apache-2.0
// The photograph of the test view that is shown, drawn where the view lies in the picture.

import { LinearFilter, LinearMipmapLinearFilter, Texture, type WebGLRenderer } from 'three';
import type { TestCamera } from '../format/ngsplat';
import type { View } from '../camera/view';
import { fullscreenPass, uniforms } from '../render/pass';
import code from './photograph.frag.glsl?raw';

/** Throws Error with a message for the user. */
async function fetchPicture(path: string, camera: TestCamera, signal: AbortSignal): Promise<ImageBitmap> {
  const response = await fetch(path, { signal });
  if (!response.ok) throw new Error(`the server answers ${response.status} ${response.statusText}`);
  const bitmap = await createImageBitmap(await response.blob(), {
    colorSpaceConversion: 'none',
    premultiplyAlpha: 'none',
  });
  const scale = bitmap.width / camera.width; // a large photograph may come smaller
  if (scale <= 1 && Math.abs(bitmap.height - scale * camera.height) <= 1) return bitmap;
  throw new Error(`it has ${bitmap.width} x ${bitmap.height} pixels, its test view ${camera.width} x ${camera.height}`);
}

export class Photograph {
  private readonly pass = fullscreenPass(
    code,
    uniforms({ photograph: null, corner: [0, 0], extent: [1, 1], height: 1 }),
  );
  private texture: Texture | undefined;
  private path: string | undefined;
  private transfer = new AbortController();
  /** Why it cannot be drawn; undefined where it can. */
  obstacle: string | undefined;

  /** `changed` is called when there is something to draw, or to say. */
  constructor(private readonly changed: () => void) {}

  /** Fetches the photograph, unless it is there or on its way. */
  show(path: string, camera: TestCamera): void {
    if (path === this.path) return;
    this.clear();
    this.path = path;
    this.obstacle = 'The photograph is on its way.';
    const { signal } = this.transfer;
    fetchPicture(path, camera, signal).then(
      (bitmap) => {
        if (signal.aborted) return;
        this.texture = new Texture(bitmap);
        this.texture.flipY = false;
        this.texture.magFilter = LinearFilter;
        this.texture.minFilter = LinearMipmapLinearFilter;
        this.texture.needsUpdate = true;
        this.obstacle = undefined;
        this.changed();
      },
      (error: Error) => {
        if (signal.aborted) return;
        this.obstacle = `${path} cannot be shown: ${error.message}`;
        this.changed();
      },
    );
  }

  draw(renderer: WebGLRenderer, camera: TestCamera, view: View): void {
    const scale = Math.min(view.width / camera.width, view.height / camera.height); // as fitView
    const extent = [scale * camera.width, scale * camera.height];
    this.pass.set({
      photograph: this.texture,
      corner: [(view.width - extent[0]) / 2, (view.height - extent[1]) / 2],
      extent,
      height: view.height,
    });
    this.pass.draw(renderer, null);
  }

  clear(): void {
    this.transfer.abort();
    this.transfer = new AbortController();
    (this.texture?.image as ImageBitmap | undefined)?.close();
    this.texture?.dispose();
    this.texture = this.path = undefined;
  }
}
