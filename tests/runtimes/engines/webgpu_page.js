/** What WebGPU shades with prt.wgsl: one number for each vertex, read back as floats. */

const WIDTH = 64; // pixels; a row of 16 bytes each is a multiple of 256, as copies want it

async function deviceOrNothing() {
  const adapter = await navigator.gpu?.requestAdapter();
  return adapter ? adapter.requestDevice() : null;
}

/** Errors that the compiler of the browser finds, or null without WebGPU. */
async function compile(code) {
  const device = await deviceOrNothing();
  if (!device) return null;
  device.addEventListener("uncapturederror", (event) => event.preventDefault());
  const { messages } = await device.createShaderModule({ code }).getCompilationInfo();
  return messages.filter(({ type }) => type === "error").map(({ message }) => message);
}

/** Triangles about the middle of one pixel for each vertex, three corners of (x, y, 0) in clip space. */
function places(count, height) {
  const corners = [-0.4, -0.4, 0.4, -0.4, 0, 0.4];
  return new Float32Array(
    Array.from({ length: 3 * count }, (_, n) => {
      const [i, corner] = [Math.floor(n / 3), n % 3];
      const [x, y] = [(i % WIDTH) + 0.5 + corners[2 * corner], Math.floor(i / WIDTH) + 0.5 + corners[2 * corner + 1]];
      return [(2 * x) / WIDTH - 1, 1 - (2 * y) / height, 0];
    }).flat(),
  );
}

function filled(device, usage, data) {
  const buffer = device.createBuffer({ size: data.byteLength, usage, mappedAtCreation: true });
  new Uint8Array(buffer.getMappedRange()).set(new Uint8Array(data.buffer ?? data));
  buffer.unmap();
  return buffer;
}

/** `stored` are the bytes of so many attributes of four numbers, interleaved: one buffer, where eight are the limit. */
async function shade({ code, stage, fragment, format, stored, attributes, uniforms, count }) {
  const device = await deviceOrNothing();
  const height = Math.ceil(count / WIDTH);
  const size = { float32x4: 16, snorm16x4: 8, snorm8x4: 4 }[format];
  const stride = attributes * size;
  const copies = new Uint8Array(3 * stride * count);
  for (let n = 0; n < 3 * count; n++) {
    const start = Math.floor(n / 3) * stride;
    copies.set(stored.slice(start, start + stride), n * stride);
  }
  const buffers = [places(count, height), copies].map((data) => filled(device, GPUBufferUsage.VERTEX, data));
  const module = device.createShaderModule({ code });
  const pipeline = await device.createRenderPipelineAsync({
    layout: "auto",
    vertex: {
      module,
      entryPoint: stage,
      buffers: [
        { arrayStride: 12, attributes: [{ shaderLocation: 0, offset: 0, format: "float32x3" }] },
        {
          arrayStride: stride,
          attributes: Array.from({ length: attributes }, (_, i) => ({ shaderLocation: i + 1, offset: i * size, format })),
        },
      ],
    },
    fragment: { module, entryPoint: fragment, targets: [{ format: "rgba32float" }] },
  });
  const uniform = filled(device, GPUBufferUsage.UNIFORM, new Float32Array(uniforms));
  const group = device.createBindGroup({
    layout: pipeline.getBindGroupLayout(0),
    entries: [{ binding: 0, resource: { buffer: uniform } }],
  });
  const usage = GPUTextureUsage.RENDER_ATTACHMENT | GPUTextureUsage.COPY_SRC;
  const target = device.createTexture({ size: [WIDTH, height], format: "rgba32float", usage });
  const found = device.createBuffer({
    size: 16 * WIDTH * height,
    usage: GPUBufferUsage.COPY_DST | GPUBufferUsage.MAP_READ,
  });
  const encoder = device.createCommandEncoder();
  const view = target.createView();
  const pass = encoder.beginRenderPass({ colorAttachments: [{ view, loadOp: "clear", storeOp: "store" }] });
  pass.setPipeline(pipeline);
  pass.setBindGroup(0, group);
  buffers.forEach((buffer, slot) => pass.setVertexBuffer(slot, buffer));
  pass.draw(3 * count);
  pass.end();
  encoder.copyTextureToBuffer({ texture: target }, { buffer: found, bytesPerRow: 16 * WIDTH }, [WIDTH, height]);
  device.queue.submit([encoder.finish()]);
  await found.mapAsync(GPUMapMode.READ);
  const values = new Float32Array(found.getMappedRange());
  return Array.from({ length: count }, (_, i) => [...values.slice(4 * i, 4 * i + 3)]);
}

globalThis.compile = compile;
globalThis.shadeVertices = (said) =>
  shade({ ...said, stored: Uint8Array.from(atob(said.stored), (c) => c.charCodeAt(0)) });
