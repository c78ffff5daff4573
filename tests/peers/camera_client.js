// Qualisys's JavaScript SDK against a server of oqtal.
//
// usage: node camera_client.js PORT BODY FRAMES
// Prints what camera_clients.py prints. Run by mocap-emu/tests/camera_peers.rs, where Node.js has the packages of package.json.

const qtm = require('qualisys-rt');

const [port, body, frames] = [Number(process.argv[2]), process.argv[3], Number(process.argv[4])];
const api = new qtm.Api({ debug: false });
const collected = [];
let names = [];

function finish() {
	const text = JSON.stringify({ bodies: names, frames: collected });
	// A pipe takes 64 KiB at once: the process ends when the rest is written, too.
	process.stdout.write(text + '\n', function () { process.exit(0); });
}

api.on('frame', function (frame) {
	const component = frame.components['6d'] || frame.components['6D'];
	const rigid = component && component.rigidBodies[names.indexOf(body)];
	if (!rigid || rigid.x === null) return;
	const position = [rigid.x, rigid.y, rigid.z].map(function (value) { return value * 1e-3; });
	collected.push([frame.frame, position, Array.from(rigid.rotation)]);
	if (collected.length === frames) finish();
});

api.connect(port, '127.0.0.1')
	.then(function () { return api.getParameters('6D'); })
	.then(function (parameters) {
		const bodies = [].concat(parameters.the6d.rigidBodies);
		names = bodies.map(function (entry) { return entry.name; });
		return api.streamFrames({ components: ['6D'], frequency: 'AllFrames' });
	})
	.catch(function (error) { console.error(error); process.exit(1); });
