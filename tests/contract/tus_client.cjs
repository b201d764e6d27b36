// Sends a file with tus-js-client, gives up in the middle and goes on with a new upload, as after a restart. Prints the address.
//
//     NODE_PATH=... node tus_client.cjs URL TOKEN ROPE_ID FILE

const fs = require("node:fs");
const tus = require("tus-js-client");

const [endpoint, token, ropeId, path] = process.argv.slice(2);
const size = fs.statSync(path).size;
const chunkSize = Math.ceil(size / 7);

function upload(options) {
  return new Promise((resolve, reject) => {
    const one = new tus.Upload(fs.createReadStream(path), {
      endpoint,
      uploadSize: size,
      chunkSize,
      retryDelays: null,
      headers: { Authorization: `Bearer ${token}` },
      metadata: { filename: "rope.tar", rope_id: ropeId },
      onError: reject,
      onSuccess: () => resolve(one.url),
      ...options(() => one, resolve),
    });
    one.start();
  });
}

(async () => {
  const url = await upload((one, resolve) => ({
    onChunkComplete: (_, sent) => {
      if (sent > size / 3) one().abort().then(() => resolve(one().url));
    },
  }));
  const again = await upload(() => ({ uploadUrl: url }));
  if (again !== url) throw new Error(`a new upload began: ${url}, then ${again}`);
  console.log(url);
})().catch((error) => {
  console.error(error);
  process.exit(1);
});
