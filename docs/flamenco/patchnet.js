// SPDX-License-Identifier: GPL-3.0-or-later
//
// PatchNet on a Flamenco 3 farm, frame by frame: copy this file into the folder `scripts` beside flamenco-manager and
// choose "PatchNet" in Blender's Output properties, panel Flamenco 3.
//
// One frame is made first, and its automatic exposure is that of all: machines that share frames cannot agree
// otherwise. Then each task makes some frames, and in the end a task looks that all are there and writes report.json
// about them. A frame that is there and would become the same again is skipped, so a job that failed can simply be sent
// again under its name. Workers need Blender with the PatchNet extension enabled.

const JOB_TYPE = {
  label: "PatchNet",
  description: "Bake voxels of every frame and refine its pictures where they are wrong",
  settings: [
    {
      key: "frames", type: "string", required: true,
      eval: "f'{C.scene.frame_start}-{C.scene.frame_end}'",
      evalInfo: { showLinkButton: true, description: "Scene frame range" },
      description: "Frame range. Examples: '47', '1-30', '3, 5-10, 47-327'",
    },
    {
      key: "chunk_size", type: "int32", default: 1, propargs: { min: 1 }, visible: "submission",
      description: "Number of frames that one task makes",
    },
    {
      key: "exposure_frame", type: "int32", required: true, eval: "C.scene.frame_current",
      evalInfo: { showLinkButton: true, description: "Current frame" },
      description: "Frame whose automatic exposure is that of all frames; a bright one. It is made even if Frames lack it",
    },
    {
      key: "depth", type: "string", required: true, default: "auto",
      description: "Octree depth, or auto, or fit. A number gives all frames the same",
    },
    {
      key: "light", type: "string", required: true, default: "cycles", choices: ["cycles", "two-lights"],
      description: "Light that Cycles bakes, or the paper's two lights",
    },
    {
      key: "samples", type: "int32", required: true, default: 4, propargs: { min: 1 },
      description: "Cycles samples of each baked texel",
    },
    {
      key: "cameras", type: "string", required: true, default: "all",
      description: "Names with commas between, all, or auto",
    },
    {
      key: "width", type: "int32", required: true, default: 192, propargs: { min: 0 },
      description: "Pixels; 0 follows the render aspect, 0 and 0 are the render resolution",
    },
    { key: "height", type: "int32", required: true, default: 192, propargs: { min: 0 }, description: "Pixels" },

    // Where results go: a folder named after the job, so that the same job sent again finds what is there.
    {
      key: "output_root", type: "string", subtype: "dir_path", required: true, visible: "submission", default: "//out",
      description: "Folder that all workers see; the job gets a folder of its name in it",
    },
    {
      key: "output_folder", type: "string", subtype: "dir_path", editable: false,
      eval: "str(Path(abspath(settings.output_root), jobname))",
      description: "Folder of frame-0001 and so on",
    },

    {
      key: "blender_command", type: "string", required: true, default: "{blender}", visible: "web",
      description: "Blender as the workers find it",
    },
    { key: "blendfile", type: "string", required: true, visible: "web", description: "Path of the Blend file" },
  ],
};

function compileJob(job) {
  const settings = job.settings;
  if (!settings.output_folder) {
    throw new Error("PatchNet: the job has no output folder; choose one as Output Root");
  }
  const chunks = frameChunker(settings.frames, settings.chunk_size);
  const all = frameChunker(settings.frames, 1000000).join(",");

  const exposure = patchnetTask("exposure", settings, String(settings.exposure_frame));
  job.addTask(exposure);

  const report = patchnetTask("report", settings, all);
  for (const chunk of chunks) {
    const task = patchnetTask("frames-" + chunk, settings, chunk);
    task.addDependency(exposure);
    report.addDependency(task);
    job.addTask(task);
  }
  job.addTask(report);
}

// Make the task that makes some frames. All tasks have the same settings: else frames would not count as made.
function patchnetTask(name, settings, frames) {
  const task = author.Task(name, "blender");
  task.addCommand(author.Command("exec", {
    exe: settings.blender_command,
    args: [
      "--command", "patchnet", "run", settings.blendfile,
      "--frames", frames,
      "--out", settings.output_folder,
      "--depth", String(settings.depth),
      "--light", settings.light,
      "--samples", String(settings.samples),
      "--cameras", settings.cameras,
      "--size", String(settings.width), String(settings.height),
    ],
  }));
  return task;
}
