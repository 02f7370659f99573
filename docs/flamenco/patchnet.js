// SPDX-License-Identifier: GPL-3.0-or-later
//
// PatchNet on a Flamenco 3 farm, frame by frame: copy this file into the folder `scripts` beside flamenco-manager and
// choose "PatchNet" in Blender's Output properties, panel Flamenco 3.
//
// The first task makes one frame, whose automatic exposure all frames use. Then each task makes some frames. The last
// task checks that all frames exist and writes report.json. Frames that are up to date are skipped: submit a failed job
// again under its name. Workers need Blender with the PatchNet extension enabled.

const JOB_TYPE = {
  label: "PatchNet",
  description: "Bake voxels of every frame, and refine its pictures where they are wrong",
  settings: [
    {
      key: "frames", type: "string", required: true,
      eval: "f'{C.scene.frame_start}-{C.scene.frame_end}'",
      evalInfo: { showLinkButton: true, description: "Scene frame range" },
      description: "Frame range. Examples: '47', '1-30', '3, 5-10, 47-327'",
    },
    {
      key: "chunk_size", type: "int32", default: 1, propargs: { min: 1 }, visible: "submission",
      description: "Number of frames per task",
    },
    {
      key: "exposure_frame", type: "int32", required: true, eval: "C.scene.frame_current",
      evalInfo: { showLinkButton: true, description: "Current frame" },
      description: "Bright frame whose automatic exposure all frames use. It is made even if it is not in Frames",
    },
    {
      key: "depth", type: "string", required: true, default: "auto",
      description: "Octree depth, or auto for voxels fitted to the cameras of each frame",
    },
    {
      key: "light", type: "string", required: true, default: "cycles", choices: ["cycles", "two-lights"],
      description: "Light that Cycles bakes, or the paper's two lights",
    },
    {
      key: "max_samples", type: "int32", required: true, default: 32, propargs: { min: 2 },
      description: "Most Cycles samples of a place whose light is baked",
    },
    {
      key: "cameras", type: "string", required: true, default: "all",
      description: "Camera names separated by commas, all, or auto",
    },
    {
      key: "width", type: "int32", required: true, default: 192, propargs: { min: 0 },
      description: "Pixels; 0 follows the render aspect, 0 and 0 are the render resolution",
    },
    { key: "height", type: "int32", required: true, default: 192, propargs: { min: 0 }, description: "Pixels" },

    // Results are in a folder named after the job, so that the job submitted again finds finished frames.
    {
      key: "output_root", type: "string", subtype: "dir_path", required: true, visible: "submission", default: "//out",
      description: "Folder shared by all workers; results are in a subfolder with the job's name",
    },
    {
      key: "output_folder", type: "string", subtype: "dir_path", editable: false,
      eval: "str(Path(abspath(settings.output_root), jobname))",
      description: "Folder of the frames' folders, frame-0001 and so on",
    },

    {
      key: "blender_command", type: "string", required: true, default: "{blender}", visible: "web",
      description: "Command of Blender on the workers",
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

// Make a task of some frames. All tasks have the same settings, so that finished frames count.
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
      "--max-samples", String(settings.max_samples),
      "--cameras", settings.cameras,
      "--size", String(settings.width), String(settings.height),
    ],
  }));
  return task;
}
