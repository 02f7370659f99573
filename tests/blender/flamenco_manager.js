// SPDX-License-Identifier: GPL-3.0-or-later
//
// What Flamenco Manager does with a job type, for the tests: node flamenco_manager.js JOB_TYPE.js, and on stdin
// {"settings": {...}} of a job. Prints {"job_type": ..., "tasks": [...]}; without settings no job is compiled.
// Names and arguments are those of Flamenco 3 (internal/manager/job_compilers): author.Task, author.Command,
// frameChunker, print.

const fs = require("fs");
const vm = require("vm");

class Task {
  constructor(name, type) {
    Object.assign(this, { name, type, commands: [], dependencies: [] });
  }
  addCommand(command) {
    if (!(command instanceof Command)) throw new TypeError("addCommand takes what author.Command makes");
    this.commands.push(command);
  }
  addDependency(task) {
    if (!(task instanceof Task)) throw new TypeError("addDependency takes what author.Task makes");
    this.dependencies.push(task.name);
  }
}

class Command {
  constructor(name, parameters) {
    Object.assign(this, { name, parameters });
  }
}

function framesOf(range) {
  const frames = new Set();
  for (const part of range.replaceAll("..", "-").split(",")) {
    const ends = part.split("-").map((text) => text.trim());
    if (ends.length > 2 || !ends.every((text) => /^\d+$/.test(text))) throw new Error(`invalid range "${range}"`);
    for (let frame = Number(ends[0]); frame <= Number(ends[ends.length - 1]); frame++) frames.add(frame);
  }
  return [...frames].sort((one, other) => one - other);
}

function merged(frames) {
  const ranges = [];
  for (const frame of frames) {
    const last = ranges[ranges.length - 1];
    if (last && last[1] === frame - 1) last[1] = frame;
    else ranges.push([frame, frame]);
  }
  return ranges.map(([first, last]) =>
    first === last ? `${first}` : first + 1 === last ? `${first},${last}` : `${first}-${last}`).join(",");
}

function frameChunker(range, size) {
  if (!Number.isInteger(size) || size < 1) throw new Error(`invalid chunk size: ${size}`);
  const frames = framesOf(range);
  const chunks = [];
  for (let first = 0; first < frames.length; first += size) chunks.push(merged(frames.slice(first, first + size)));
  return chunks;
}

const script = fs.readFileSync(process.argv[2], "utf-8");
const given = JSON.parse(fs.readFileSync(0, "utf-8"));
const author = { Task: (name, type) => new Task(name, type), Command: (name, words) => new Command(name, words) };
const context = vm.createContext({ author, frameChunker, print: () => {} });
vm.runInContext(`${script}\n;globalThis.job_type = JOB_TYPE; globalThis.compile = compileJob;`, context);

const tasks = [];
if (given.settings) context.compile({ name: "job", settings: given.settings, addTask: (task) => tasks.push(task) });
process.stdout.write(JSON.stringify({ job_type: context.job_type, tasks }));
