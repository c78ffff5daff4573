// A browser with the page of `oqtal view`. Run by tests/view.rs, where Node.js has the packages of package.json.
//
// usage: node view_page.js CHROMIUM URL live|control|silent|recorded [TOKEN]
// Prints one JSON document: what was seen, every error on the console, every request that went elsewhere.

const { chromium } = require('playwright-core');

const [executablePath, url, what, token] = process.argv.slice(2);
const FLAGS = [
	'--no-sandbox', '--disable-gpu', '--disable-quic', '--no-first-run', '--disable-background-networking',
	'--disable-component-update', '--disable-sync',
];
const TIMEOUT = { timeout: 60000 };

// Pixels of the room in the colour of the path.
function drawn() {
	const canvas = document.getElementById('room');
	const probe = document.createElement('canvas').getContext('2d');
	probe.fillStyle = getComputedStyle(document.documentElement).getPropertyValue('--actual');
	probe.fillRect(0, 0, 1, 1);
	const [r, g, b] = probe.getImageData(0, 0, 1, 1).data;
	const { data } = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
	let pixels = 0;
	for (let i = 0; i < data.length; i += 4) {
		const distance = Math.abs(data[i] - r) + Math.abs(data[i + 1] - g) + Math.abs(data[i + 2] - b);
		if (data[i + 3] > 200 && distance < 30) pixels += 1;
	}
	return pixels;
}

const text = (page, id) => page.evaluate((name) => document.getElementById(name)?.textContent, id);

function until(page, id, part) {
	const has = ([name, wanted]) => document.getElementById(name)?.textContent.includes(wanted);
	return page.waitForFunction(has, [id, part], TIMEOUT);
}

async function live(page) {
	const isFast = () => Number(/(\d+) updates/.exec(document.getElementById('connection').textContent)?.[1]) >= 30;
	await page.waitForFunction(isFast, null, TIMEOUT);
	const updates = Number(/(\d+) updates/.exec(await text(page, 'connection'))?.[1]);
	const first = await text(page, 'figures');
	await page.waitForFunction((before) => document.getElementById('figures').textContent !== before, first, TIMEOUT);
	return { updates, control: await page.isVisible('#control') };
}

// A command by a page without the token, and one by a page of another site.
async function refusals(page, context) {
	const post = (target) => fetch(target, { method: 'POST', body: '{"command": "arm"}' })
		.then((response) => response.status, () => 'blocked');
	const here = await page.evaluate(post, '/control');
	const elsewhere = await context.newPage();
	await elsewhere.goto('about:blank');
	const foreign = await elsewhere.evaluate(post, `${url}control`);
	await elsewhere.close();
	return { here, foreign };
}

async function control(page, context) {
	await live(page);
	const refused = await refusals(page, context);
	await page.fill('#token', 'wrong');
	await page.click('#unlock button');
	await until(page, 'answer', 'token');
	await page.fill('#token', token);
	await page.click('#unlock button');
	await until(page, 'answer', 'daemon: disarmed');
	// Poses may be late on a busy machine, before or after the take-off: the operator arms until the vehicle is in the air.
	for (let tries = 0; tries < 120 && !(parseFloat(await text(page, 'z')) > 0.3); tries += 1) {
		if ((await text(page, 'mode')).includes('disarmed')) {
			await page.click('#arm');
			await page.click('#arm');
		}
		await page.waitForTimeout(500);
	}
	const armed = await text(page, 'answer');
	await until(page, 'mode', 'trajectory');
	await page.fill('#goto-x', '0.4');
	await page.click('#goto button:not([type])');
	await until(page, 'answer', 'goto: on its way');
	await page.waitForFunction(() => parseFloat(document.getElementById('x')?.textContent) > 0.3, null, TIMEOUT);
	// The first gain of the law that flies, to the middle of its slider.
	await page.$eval('#gains input', (slider) => {
		slider.value = 500;
		slider.dispatchEvent(new Event('change'));
	});
	// Accepted: the loop did not confirm it within the time that the daemon waits.
	await page.waitForFunction(
		() => /set: (done|accepted)/.test(document.getElementById('answer').textContent), null, TIMEOUT,
	);
	const tuned = await text(page, 'answer');
	const ended = await landing(page);
	await until(page, 'mode', 'disarmed');
	return { refused, armed, tuned, ...ended, pixels: await page.evaluate(drawn) };
}

// A landing while the connection delays a hover by 4 s, and a goto waits for the answer to that.
async function landing(page) {
	const is = (name) => (it) => it.postData()?.includes(`"${name}"`);
	let gotos = 0;
	await page.route('**/control', async (route) => {
		if (is('goto')(route.request())) gotos += 1;
		if (is('hover')(route.request())) await page.waitForTimeout(4000);
		await route.continue();
	});
	const [sent, answered] = [
		page.waitForRequest(is('hover'), TIMEOUT), page.waitForResponse((it) => is('hover')(it.request()), TIMEOUT),
	];
	await page.click('#hover');
	await sent;
	await page.click('#goto button:not([type])');
	const landed = page.waitForResponse((it) => is('land')(it.request()), TIMEOUT);
	await page.click('#land');
	const [land, hover] = [await (await landed).text(), await (await answered).text()];
	return { landing: land, late: hover, gotos };
}

// The page after daemon and vehicle have ended.
async function silent(page) {
	await until(page, 'connection', 'no tick');
	await until(page, 'state', 'unknown');
	await until(page, 'figures', 'Motorsunknown');
	return { mode: await text(page, 'mode'), z: await text(page, 'z'), figures: await text(page, 'figures') };
}

async function recorded(page) {
	await until(page, 'connection', 'recording');
	await page.waitForTimeout(200);
	const before = await text(page, 'place');
	const largest = await page.getAttribute('#time', 'max');
	await page.evaluate((value) => {
		const slider = document.getElementById('time');
		slider.value = value;
		slider.dispatchEvent(new Event('input'));
	}, Number(largest) * 0.7);
	await page.waitForFunction((was) => document.getElementById('place').textContent !== was, before, TIMEOUT);
	await page.click('#play');
	const clock = await text(page, 'clock');
	await page.waitForFunction((was) => document.getElementById('clock').textContent !== was, clock, TIMEOUT);
	const still = await page.evaluate(drawn);
	const box = await page.locator('#room').boundingBox();
	const picture = () => page.evaluate(() => document.getElementById('room').toDataURL());
	await page.click('#play');
	await page.waitForTimeout(200);
	const unturned = await picture();
	await page.mouse.move(box.x + 200, box.y + 150);
	await page.mouse.down();
	await page.mouse.move(box.x + 320, box.y + 190, { steps: 4 });
	await page.mouse.up();
	await page.waitForTimeout(200);
	return { pixels: still, turned: (await picture()) !== unturned, events: await page.locator('#events li').count() };
}

async function main() {
	const browser = await chromium.launch({ executablePath, args: FLAGS });
	const context = await browser.newContext({ viewport: { width: 1200, height: 900 } });
	const page = await context.newPage();
	const [errors, elsewhere] = [[], []];
	// A refused command is reported on the console as well: those are asked for.
	page.on('console', (message) => {
		const isRefusal = /status of 40[139]/.test(message.text());
		if (['error', 'warning'].includes(message.type()) && !isRefusal) errors.push(message.text());
	});
	page.on('pageerror', (error) => errors.push(error.message));
	page.on('request', (request) => { if (!request.url().startsWith(url)) elsewhere.push(request.url()); });
	await page.goto(url);
	const seen = await { live, control, silent, recorded }[what](page, context);
	console.log(JSON.stringify({ ...seen, errors, elsewhere: elsewhere.filter((one) => !one.startsWith('data:')) }));
	await browser.close();
}

main().catch((error) => { console.error(error); process.exit(1); });
