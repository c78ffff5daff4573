// Reads every message of a recording with the MCAP project's JavaScript package.
//
// usage: node mcap_reader.js FILE
// Prints one JSON object as mcap_reader.py does: messages by topic, read and by the index, schemas, whether times are ordered.
// Run by tests/recordings.rs, where Node.js has the packages of package.json.

const fs = require('fs');
const { McapIndexedReader } = require('@mcap/core');

async function main() {
	const file = await fs.promises.open(process.argv[2], 'r');
	const { size } = await file.stat();
	const readable = {
		size: async function () { return BigInt(size); },
		read: async function (offset, length) {
			const bytes = new Uint8Array(Number(length));
			await file.read(bytes, 0, bytes.length, Number(offset));
			return bytes;
		},
	};
	const reader = await McapIndexedReader.Initialize({ readable });
	const topic = function (id) { return reader.channelsById.get(id).topic; };
	const [messages, indexed, schemas] = [{}, {}, {}];
	let [last, ordered] = [0n, true];
	for await (const message of reader.readMessages({ validateCrcs: true })) {
		const name = topic(message.channelId);
		messages[name] = (messages[name] || 0) + 1;
		const schema = reader.schemasById.get(reader.channelsById.get(message.channelId).schemaId);
		schemas[name] = schema.name;
		ordered = ordered && message.logTime >= last && message.data.length > 4;
		last = message.logTime;
	}
	for (const [id, count] of reader.statistics.channelMessageCounts) {
		indexed[topic(id)] = Number(count);
	}
	console.log(JSON.stringify({ messages, indexed, schemas, ordered }));
}

main();
