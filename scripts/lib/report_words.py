"""The words of the report's page: what keys of results.json are called, and what its sections say."""

# Key: heading, or (heading, factor) for a share that is shown in per cent.
PERCENT = 100  # what shares are multiplied by
HEADINGS = {
    "us_per_frame": "time per frame, µs", "us": "time per frame, µs", "mesh_tets": "tetrahedra", "than_tets": "compared with",
    "worst_mm": "worst distance, mm", "mean_mm": "mean error, mm", "chords": "chord steps",
    "factorisations": "factorisations", "scalar": "arithmetic", "way": "method", "sum_us": "whole iteration, µs",
    "derivatives_us": "derivatives, µs", "factor_us": "factor, µs", "solve_us": "solve, µs", "step_us": "step, µs",
    "factor_operations": "operations of a factor", "derivative_operations": "operations of the derivatives", "name": "case", "frames": "frames", "flagged": "frames flagged",
    "iterations": "most steps", "end_mm": "distance at the end, mm", "good": "held",
    "touch_point_clean_mm": "touched point, exact poses, mm", "touch_point_noisy_mm": "touched point, with noise, mm",
    "front_clean_mm": "front face, exact poses, mm", "front_noisy_mm": "front face, with noise, mm",
    "all_clean_mm": "all nodes, exact poses, mm", "all_noisy_mm": "all nodes, with noise, mm",
    "allowed_mm": "its limit, mm", "allowed_end_mm": "its limit at the end, mm",
    "quantisation_loss_mm": "int8 answers away from float's, mm", "distance_from_mm": "distance from, mm",
    "frame_cpu_ms_p50": "processor time of a frame, median, ms", "frame_cpu_ms_p99": "processor time of a frame, 99 %, ms",
    "frame_ms_p50": "a frame, median, ms", "frame_ms_p99": "a frame, 99 %, ms", "poses_ms_p50": "poses, median, ms",
    "cost_us_by_round": "cost by round, µs", "loop_cost_us": "cost, median of the rounds, µs",
    "allowed_us": "aim of the cost, µs", "memory_kb_before": "memory before, kB", "memory_kb_after": "memory after, kB",
    "truth_within_position_95": ("truth within the position's 95 %, %", PERCENT),
    "truth_within_uncertainty": ("truth within position or extent, %", PERCENT),
    "extent_95_mm": "extent, 95 %, mm", "position_95_mm": "position, 95 %, mm",
    "leaked": ("test rows that are in the training set, too, %", PERCENT),
    "contact_map_share": ("answered by the contact map, %", PERCENT),
    "case": "case", "contained": "in the pack's scene", "trials": "touches", "published": ("published, %", PERCENT), "published_radius_mm": "published radius, mm",
    "unexplained": ("unexplained, %", PERCENT), "touch_mm": "touch, mean error, mm", "touch_95_mm": "95 %, mm",
    "inside_radius": ("inside one radius, %", PERCENT), "inside_radius_error": ("standard error by places, points", PERCENT), "inside_twice": ("inside two, %", PERCENT),
    "lies": ("published and off by over three radii, % of all", PERCENT), "force_rmse_n": "force RMSE, N (normal / across / along)",
    "force_told": ("force told, %", PERCENT), "force_inside": ("force inside its deviation, %", PERCENT),
    "moment_rmse_nm": "moment RMSE, N m (x / y / z)", "moment_inside": ("moment inside its deviation, %", PERCENT),
    "level_bias": ("deformation, mean error, %", PERCENT), "level_95": ("deformation, 95 %, %", PERCENT),
    "largest_bias_mm": "largest displacement, mean error, mm", "largest_95_mm": "its 95 %, mm", "tier": "tier",
    "unknown": "unknown", "states": "states", "x_mm": "x, mm", "y_mm": "y, mm", "normal_n": "normal, N",
    "across_n": "across, N", "along_n": "along, N", "radius_mm": "patch radius, mm", "x_mm_2": "second x, mm",
    "y_mm_2": "second y, mm", "normal_n_2": "second normal, N", "across_n_2": "second across, N",
    "along_n_2": "second along, N", "radius_mm_2": "second radius, mm",
    "alike": ("more than half missed by any test, %", PERCENT),
    "alike_off_mm": "there, the one contact is away by, mm", "found_at_best": ("found by the best test, %", PERCENT),
    "lies_at_best": ("off by over three radii with it, %", PERCENT),
    "from_mm": "plate motion from, mm", "touches": "touches", "error_95_mm": "95 %, mm",
    "coverage_68": ("inside one radius, %", PERCENT), "coverage_95": ("inside two, %", PERCENT),
    "from_n": "force from, N", "rmse_n": "RMSE, N", "bias_n": "mean error, N",
    "rmse_mm": "RMSE, mm (x / y / z)", "r2": "R² (x / y / z)", "false_valid": ("touches published of none, %", PERCENT),
    "flips_per_1000": "flipped poses in 1,000 frames", "level_rmse_permille": "deformation RMSE, ‰",
    "estimate_us_p50": "estimate, median, µs", "estimate_us_p99": "99 %, µs", "preset": "preset", "method": "method",
    "touch_mm_2_to_4": "touch at 2–4 mm of motion, mm", "touch_mm_above_4": "touch from 4 mm, mm",
    "touch_mm_above_7": "touch from 7 mm, mm", "element": "element", "tets": "tetrahedra", "load": "load", "force_n": "force, N",
    "largest_mm": "largest displacement, mm", "difference_mm": "difference, mm", "C3D4_mm": "C3D4, mm",
    "C3D10_mm": "C3D10, mm", "selective_mm": "selective, mm", "touch": "touch", "contacts": "contacts found",
    "front_mm": "front face, mm", "force_error_n": "force error, N", "position_95_mm": "least certain place, 95 %, mm",
    "truth_within_uncertainty": ("truth inside its deviation, %", PERCENT), "gauss_newton_s": "Gauss-Newton, s",
    "lbfgs_s": "L-BFGS, s", "lbfgs_front_mm": "L-BFGS, front face, mm", "lbfgs_force_n": "L-BFGS, force, N",
    "boot_s": "power to the first Modbus answer, emulated, s", "boot_parts_s": "its parts, s",
    "own_start_s": "start of our own program, emulated, median of three, s",
    "own_start_longest_s": "… and the longest of the three, s",
    "own_start_million_instructions": "instructions while our program starts, million",
    "a72_own_start_s_estimated": "start of our own program on a Cortex-A72 of 1.8 GHz at one instruction in a cycle (estimated), s",
    "frame_million_instructions": "instructions of a frame, million",
    "a72_frame_ms_estimated": "a frame on a Cortex-A72 of 1.8 GHz at one instruction in a cycle (estimated), ms",
    "reads": "reads", "p50_us": "median, µs", "p99_us": "99 %, µs", "attacks_per_s": "attacks in a second",
    "heartbeat_per_s": "frames in a second", "server_cpu": "processors that the server took",
    "picture": "picture", "start": "start", "zero_frames": "frames of the zero", "firm_touches": "firm touches",
    "recall_top": ("top marker found, %", PERCENT), "recall_middle": ("middle, %", PERCENT), "recall_low": ("low, %", PERCENT),
    "family": "family", "cases": "cases", "bad": "not held", "settling_frames": "frames until settled",
    "quartiles_us": "quartiles, µs", "factor_mb": "factor, MB", "random_noisy_r2": "R², noise", "held_out_clean_r2": "R², held-out paths",
    "held_out_noisy_r2": "R², held-out paths, noise", "held_out_noisy_rmse_mm": "RMSE, held-out paths, noise, mm",
    "train_s": "training, s", "predict_us": "a prediction, µs", "random_r2": "R², random split",
    "by_contact_point_r2": "R², by contact point", "random_rmse_mm": "RMSE, random split, mm",
    "by_contact_point_rmse_mm": "RMSE, by contact point, mm", "p50_ms": "median, ms", "p99_ms": "99 %, ms", "worst_ms": "worst, ms",
    "dropped": "frames dropped", "memory_mb": "memory, MB", "growth_exponent_operations": "growth exponent of the factor's operations, up to 16,000 tetrahedra",
    "multiply_adds_per_us": "multiply-adds in a µs", "cache_bytes_per_us": "bytes read from the cache in a µs",
    "memory_bytes_per_us": "bytes read from memory in a µs",
    "fit": "fit", "forces": "forces", "force_relative": ("force, mean relative error, %", PERCENT), "force_mean_n": "mean error, N",
    "force_stated": ("stated deviation, %", PERCENT), "force_coverage_68": ("force inside its deviation, %", PERCENT), "touch_mean_mm": "touch, mean error, mm",
    "drift": ("drift over a minute, %", PERCENT), "drift_inside_deviation": ("drift inside the deviation, %", PERCENT),
    "touch_point_mm": "touched point", "path": "path", "varied": "varied", "value": "value", "corners": "corners", "markers_lost": "markers lost",
    "edges_bias_px": "edge fit, bias, px", "edges_rms_px": "edge fit, RMS, px", "sub_pix_bias_px": "cornerSubPix, bias, px",
    "sub_pix_rms_px": "cornerSubPix, RMS, px", "motion": "motion",
    "ratio_to_published": "in float, times faster than the published way in double",
    "ratio_to_eigen": "in float, times faster than Eigen's LDLT in double",
    "ratio_to_cholmod": "in float, times faster than CHOLMOD in double",
    "double_ratio_to_published": "in double, times faster than the published way in double",
    "double_ratio_to_eigen": "in double, times faster than Eigen's LDLT in double",
    "double_ratio_to_cholmod": "in double, times faster than CHOLMOD in double",
    "growth_exponent": "growth exponent of time over tetrahedra, up to 16,000",
    "iteration_ms": "one Newton iteration, ms", "published_iteration_ms": "one iteration of the published way, ms",
    "read_us_p50": "read of 48 registers, median, µs", "read_us_p99": "99 %, µs",
    "worst_coverage_error": ("of the cases that the scene contains, the one furthest from 68 % inside the radius, points", PERCENT),
    "worst_lies": ("touches published and off by over three radii, worst case of any scene, %", PERCENT),
}

# Values of cells in words.
CELLS = {
    "lr": "linear regression", "svm": "support vectors", "knn": "nearest neighbours", "dt": "decision tree",
    "mlp": "the paper's network", "paper": "the paper's network, trained by us", "history": "a quarter second of motion",
    "direction": "direction and size of the motion", "fine-tuned": "the pack's network, trained further",
    "simulation": "the pack's network as it is", "before": "before the fit", "after": "after the fit",
    "without_scale": "without the force scale", "without_creep": "without creep", "without_hysteresis": "without hysteresis",
    "without_motions": "without the change of motions", "without_offset": "without the touch offset", "smoothed": "after, poses smoothed by 50 ms",
    "zeroed_again": "after, zeroed after every touch",
    "alone": "nobody", "connect_hold": "connects and stays", "connect_reset": "connects and resets", "mute_64": "64 silent connections", "pipeline": "thousands of requests at once",
}

WORDS = {
    "comparable": "The paper's figures are those that it prints for its own finger, camera and recordings; ours are of the "
                  "same finger computed by finite elements, at the noise that the spec states, on load paths that were held out, except "
                  "where real recordings are named. The published method is its formulas as we programmed them, on the same mesh "
                  "and machine, in double, as are Eigen and CHOLMOD; ours runs in float, as the frame loop does. Growth with the "
                  "mesh has the same comparison in double. Figures in red fall "
                  "short of our own aim.",
}

PAPER_R2 = [0.968, 0.942, 0.954]  # x, y, z by its random split, on its own recordings

# What others publish, as rows under ours, by table; their fingers, cameras and tests are not ours.
PEERS = {
    "real.methods": [{"method": "the paper's network, as published", "random_r2": PAPER_R2}],
    "touch.table2": [{"method": "the paper's network on its recordings, as published", "r2": PAPER_R2}],
    "scene.cases": [{"case": "the authors' later six-axis finger, as published", "force_rmse_n": [0.25, 0.24, 0.35],
                     "moment_rmse_nm": [0.025, 0.034, 0.006]}],
}

SECTIONS = {
    "speed_error": {
        "title": "Speed against error", "area": "solver", "code": ["firmware/shape/shape_tier.h"], "figures": False,
        "text": "Time per frame on one core against three errors. Numerics: distance of every node to the converged shape of "
                "the same poses, by mesh and arithmetic. Model: distance to the finite-element shape, with noise. Registers: "
                "relative error of the published deformation, by case, and the errors of touch and force, which are the network's and the "
                "same with every tier. Grey lines join what nothing else beats: in the worst motion (numerics), on average (model), "
                "at the median over the cases (registers).",
        "notes": ["newton, the libraries and the published way run on all four meshes; newton in float, and in double with every schedule "
                  "on the pack's mesh and up to two factorisations on the others; libraries and published way in double. map and map+newton begin with a regression to one mesh's shapes, so they exist on the "
                  "pack's mesh and in float alone. measures makes no shape: the first plot leaves it out, the table gives the error of "
                  "its three figures, and the third plot shows it. contact is fitted to finite-element shapes instead of the "
                  "converged ones: it is in the second and third plot only.",
                  "newton in float on the pack's mesh is timed as the frame loop runs it, with its second tries where a step fails; "
                  "elsewhere the solver alone. For Eigen, CHOLMOD and the published way one iteration is timed and multiplied by "
                  "the number that a frame takes: Eigen and CHOLMOD are taken to make our steps in double, second tries left out."],
        "pictures": [("speed_numerics.svg", "Numerics: worst distance to the converged shape. Full marks: float; hollow: double."),
                     ("speed_model.svg", "Model: mean distance to the finite-element shape at the touched point, over the front face "
                                         "and over all nodes."),
                     ("speed_registers.svg", "Registers: 95 % of the deformation's relative error by tier and case; touch and force by case "
                                             "of the pack's scene.")],
        "tables": [("speed_error", ["tier", "mesh_tets", "factorisations", "chords", "scalar", "motion", "us_per_frame",
                                    "quartiles_us", "worst_mm", "mean_mm"], "", "")]},
    "shape": {
        "title": "Shape against the finite-element truth", "area": "touch", "code": ["firmware/shape/contact_tier.h"],
        "text": "The firmware's tiers with this pack, on states of points that it was not trained on.",
        "tables": [("shape.tiers", ["tier", "touch_point_clean_mm", "touch_point_noisy_mm", "front_clean_mm", "front_noisy_mm",
                                    "all_clean_mm", "all_noisy_mm", "us_per_frame", "quartiles_us", "contact_map_share"], "", ""),
                   ("scene.shapes", ["case", "tier", "level_bias", "level_95", "largest_bias_mm", "largest_95_mm", "us"],
                    "The registers' deformation and largest displacement, by case.", "")]},
    "solver": {
        "title": "Growth with the mesh", "area": "solver", "code": ["firmware/shape/cholesky.h", "hostgen/bench/main.cpp"],
        "text": "One Newton iteration by several methods on one core, all methods on all meshes in turn; the median of each "
                "counts, and the quartiles tell how far it may be off. Then where its time goes.",
        "notes": ["The factor's multiply-adds grow faster than its entries do: each entry of a larger separator is worked on more "
                  "often. Derivatives grow with the tetrahedra, so the exponent of the whole lies between 1 and that of the "
                  "multiply-adds.",
                  "Ours solves forward while it factors: its solve stands under factor. Operations and size are those of our factor."],
        "tabled": ["iterations", "mesh_difference"],
        "pictures": [("growth.svg", "Time of an iteration against the number of tetrahedra, and the multiply-adds of ours; exponents "
                                    "up to 16,000."),
                     ("parts.svg", "Where the time of an iteration of ours in float goes, by mesh. Black lines: how long "
                                   "the multiply-adds of derivatives and of the factor would take at this core's measured peak; "
                                   "dotted: how long memory would take to get the factor and give it back once.")],
        "tables": [("solver.iterations", ["way", "mesh_tets", "derivatives_us", "factor_us", "solve_us", "step_us", "sum_us",
                                          "quartiles_us", "derivative_operations", "factor_operations", "factor_mb"], "", ""),
                   ("solver.mesh_difference", ["mesh_tets", "than_tets", "motion", "worst_mm", "mean_mm"],
                    "How far a coarser mesh's converged shape is from the finest one's.", "")]},
    "hard_cases": {
        "title": "Hard cases", "area": "hard", "code": ["hostgen/hard_cases/hard_cases.h", "hostgen/hard_cases/hard_search.h"],
        "text": "Motions that no gripper makes: jumps, twists, near inversions, missing plates, bursts of noise, long random walks. "
                "A case holds if every shape is finite, no element is inverted without a flag, and the end is right. Then a random "
                "search for worse ones: up to five acts of these kinds, then ten frames to a moderate bend that stays. The worst is "
                "shrunk to what is about as bad, and kept in tests/hard_cases/hard_search_test.cpp if it teaches something.",
        "notes": ["No limit stands where a case asks something else than the distance: soft handles below ω = 10⁵ show what the published "
                  "way's springs cost, tiers far out of their range must only be finite and come back, a plate that is turned "
                  "around must be finite and without an unflagged inversion.",
                  "A burst of 20 times the noise once ended 0.135 mm from the converged shape on ARM. A frame whose step fails "
                  "is tried once more from rest since then; <code>ctest --preset aarch64 -R hard_cases</code> runs the cases there."],
        "tabled": ["cases", "families"],
        "pictures": [("hard_states.svg", "The ten cases whose shape was furthest from the converged one, at that moment, in front of "
                                         "the finger at rest; yellow: displaced most.")],
        "tables": [("hard_cases.families", ["family", "cases", "frames", "worst_mm", "end_mm", "iterations", "flagged", "bad"],
                    "By family.", ""),
                   ("hard_cases.search.worst", ["name", "frames", "worst_mm", "settling_frames", "end_mm", "iterations", "flagged",
                                                "good"], "The worst that the search found: distance in the frame of arrival, and "
                                                         "frames until it is below 0.02 mm.", ""),
                   ("hard_cases.search.small", ["name", "frames", "worst_mm", "settling_frames", "end_mm", "iterations", "flagged"],
                    "What is left of the first when everything is taken away that does not make it bad.", ""),
                   ("hard_cases.cases", ["family", "name", "frames", "worst_mm", "allowed_mm", "end_mm", "allowed_end_mm", "iterations", "flagged",
                                          "good"], "All cases, the largest distance first.", "worst_mm")]},
    "touch": {
        "title": "Touch and force", "area": "touch", "code": ["firmware/touch/touch_stage.h", "hostgen/learn/touch_training.h"],
        "text": "The network on contact points that it has not seen, with and without the spec's noise.",
        "pictures": [("touch_face.svg", "Touch errors over the face by contact point: states that the pack was not trained on, with "
                                        "noise, as published; a cross: never published."),
                     ("reliability.svg", "The same touches: share of errors inside the published radius, by plate motion; dotted, the "
                                         "points held out at the build."),
                     ("touch_error.svg", "Error against plate motion: contact points held out of the training, with noise, at the build."),
                     ("force_error.svg", "Error of the force against its truth, the same touches. Near the spec's highest force it "
                                         "is too low: training knows none above it.")],
        "tabled": ["table2", "face", "reliability", "coverage_curve"],
        "notes": ["Below 2 mm of plate motion (threshold_mm of the spec) no touch is published; those bands show why.",
                  "Table 2 is the paper's comparison made again on this finger's finite-element states, by its random split and by "
                  "contact point, which is the harder and the honest one. The last row is the paper's own network on its "
                  "recordings of a real finger (random split): see Real recordings, where ours stand beside it. Its states, noise and "
                  "finger differ from these, so the columns compare methods, not papers."],
        "tables": [("touch.table2", ["method", "r2", "rmse_mm", "random_noisy_r2", "held_out_clean_r2", "held_out_noisy_r2",
                                     "held_out_noisy_rmse_mm", "train_s", "predict_us"],
                    "Table 2: the paper's network and its rivals (x / y / z).", ""),
                   ("touch.by_plate_motion", ["from_mm", "touches", "mean_mm", "error_95_mm", "coverage_68", "coverage_95"],
                    "By plate motion.", ""),
                   ("touch.by_force", ["from_n", "touches", "rmse_n", "bias_n", "coverage_68"], "By force.", "")]},
    "scene": {
        "title": "What a gripper brings", "area": "scene", "code": ["hostgen/accuracy/scene_cases.h"],
        "text": "States that no training has seen, solved for each case and measured with the spec's noise by the whole firmware. A "
                "touch that is off by more than three of its radii is one that a PLC would act on wrongly.",
        "notes": ["Pushed at the tip from above no plate moves by 2 mm: there is no touch to count."],
        "pictures": [("scene_faces.svg", "True and published touches over the face, by case; axes in mm; red: off by more than three radii; "
                                         "grey circles: not published."),
                     ("scene_reliability.svg", "Share of errors inside the published radius, by case of the pack's scene; named are the "
                                               "six that are furthest from 68 %.")],
        "tables": [("scene.cases", ["case", "contained", "trials", "published", "unexplained", "touch_mm", "touch_95_mm",
                                    "inside_radius", "inside_radius_error", "inside_twice", "lies", "force_rmse_n", "force_told", "force_inside",
                                    "moment_rmse_nm", "moment_inside"], "", ""),
                   ("scene.floor", ["unknown", "states", "x_mm", "y_mm", "normal_n", "across_n", "along_n", "radius_mm", "x_mm_2",
                                    "y_mm_2", "normal_n_2", "across_n_2", "along_n_2", "radius_mm_2"],
                    "What plate motions can tell at best: median standard deviation by the Fisher information at the spec's "
                    "noise, for contacts that move a plate by 4 mm or more. Where gravity is not known it spreads by 1 g along "
                    "each axis.", ""),
                   ("scene.imitated", ["case", "states", "alike", "alike_off_mm", "found_at_best", "lies_at_best"],
                    "What the best test could find that refuses one in a thousand touches of the scene: the single contact of "
                    "the scene that moves the plates most like each state of two was searched for. Those that are taken for touches "
                    "have the median radius of touches of the scene.", "")]},
    "fit": {
        "title": "Fingers as a workshop makes them, before and after nine weights", "area": "fit",
        "code": ["hostgen/render/virtual_finger.h", "hostgen/fit/weight_fit.h"],
        "tabled": ["before", "after", "without_scale", "without_creep", "without_hysteresis", "without_motions", "without_offset", "smoothed",
                   "zeroed_again"],
        "text": "Virtual fingers that no tuning has seen: walls, stiffness, markers, camera, lens, creep, hysteresis and "
                "temperature drawn from the workshop's ranges, solved on a finer mesh than the pack's, and measured by the whole "
                "firmware from the corners of their markers on. Mount measured and zeroed once; a weight at each hole of the jig, one "
                "in each row for a minute; then touches elsewhere of any age up to 20 s, half of them after a larger force, and "
                "another weight for a minute at two of the holes, for drift. Touches count from 4 mm of plate motion on.",
        "pictures": [("fit.svg", "Each finger's mean errors, before and after the fit; below the line the fit helps.")],
        "tables": [("fit.rows", ["fit", "forces", "force_relative", "force_mean_n", "force_stated", "force_coverage_68", "touches", "touch_mean_mm",
                                 "touch_95_mm", "coverage_68", "drift", "drift_inside_deviation"],
                    "All fingers together, and with one part of the fit left out each.", "")]},
    "vision": {
        "title": "Pixels to registers", "area": "vision", "code": ["firmware/vision/observer.h"],
        "text": "Rendered images of one touch path through every stage of the firmware; times of 1280×720 pixels, one frame after the other "
                "from memory, nothing else running.",
        "notes": ["One marker alone is enough by itself where images are good and the finger bends far. The joint estimate pays at small "
                  "motions, where its prior tells noise from touch, and in bad images, where single markers flip; a frame has time "
                  "for it."],
        "tabled": ["lab", "factory", "worst"],
        "pictures": [("paths.svg", "The paper's four paths: touched points found, over the true paths.")],
        "tables": [("vision.methods", ["preset", "method", "touch_mm_2_to_4", "touch_mm_above_4", "touch_mm_above_7",
                                       "false_valid", "flips_per_1000", "coverage_68", "coverage_95", "estimate_us_p50",
                                       "estimate_us_p99"], "From the same corners to plates.", ""),
                   ("vision.lab.by_plate_motion", ["from_mm", "touches", "touch_mm", "touch_95_mm", "force_rmse_n",
                                                   "level_rmse_permille", "coverage_68", "coverage_95"],
                    "Preset lab, by plate motion.", ""),
                   ("vision.paths", ["path", "touches", "touch_mm", "touch_95_mm"], "The paper's four paths.", ""),
                   ("vision.corners", ["varied", "value", "corners", "markers_lost", "edges_bias_px", "edges_rms_px",
                                       "sub_pix_bias_px", "sub_pix_rms_px"], "Corners in 1280×720 images.", "")]},
    "pictures": {
        "title": "Pictures as cameras make them", "area": "pictures", "code": ["hostgen/render"],
        "text": "Coded, blurred, noisy, dim, glaring, badly printed pictures through the whole firmware, with a zero, without "
                "one, and with a measured mount: touches of the pack's scene, each by itself. The rows called fast: one "
                "frictionless touch that wanders over the face, its frames one after the other.",
        "starts": ["zeroed", "unzeroed", "mounted"],
        "tables": [("", ["picture", "start", "zero_frames", "firm_touches", "published", "touch_mm", "published_radius_mm",
                         "coverage_68", "lies", "recall_top", "recall_middle", "recall_low"], "", "")]},
    "fem": {
        "title": "Finite-element truth", "area": "fem", "code": ["hostgen/fem/statics.h"],
        "text": "How far the training truth can be trusted: the same loads solved by CalculiX with its elements, and what these and the "
                "selective element, which all truth is made with, answer on finer and finer meshes.",
        "tables": [("fem.calculix", ["element", "tets", "load", "x_mm", "y_mm", "force_n", "largest_mm", "difference_mm"], "", ""),
                   ("fem.locking", ["mesh", "tets", "C3D4_mm", "C3D10_mm", "selective_mm"],
                    "How far 0.5 N at (0, 70) moves a plate at most.", "")]},
    "real": {
        "title": "Real recordings", "area": "real", "code": ["hostgen/recordings"],
        "text": "A real finger's recorded plate motions: split at random as the paper does it, and by contact point.",
        "pictures": [("recordings.svg", "Contact points, rotations and motions of the recordings.")],
        "tabled": ["methods"],
        "notes": ["The paper publishes its random split, the last row, and nothing by contact point. 40 % of a random "
                  "split's test rows are in its training set, and the touch in the recordings was computed from the plate's pose: "
                  "errors against it say how well two reconstructions agree."],
        "tables": [("real.methods", ["method", "random_r2", "by_contact_point_r2", "random_rmse_mm", "by_contact_point_rmse_mm",
                                     "mean_mm"], "By method and split (x / y / z).", "")]},
    "force": {
        "title": "Contact forces, offline", "area": "force", "code": ["hostgen/fem/contact_forces.h"],
        "text": "Forces on the face from plate motions with noise: Gauss-Newton beside the paper's L-BFGS.",
        "pictures": [("contact_forces.svg", "Half of the misfit between measured and modelled plate motion against time.")],
        "notes": ["A spread load (pressure, edge) is told as one or two contacts: its points lie within the extent, not within the "
                  "position. L-BFGS ends at a lower misfit in most cases and further from the truth: with hundreds of free forces it "
                  "fits the noise; Gauss-Newton stops where the misfit is what the noise explains."],
        "tables": [("force.cases", ["touch", "force_n", "contacts", "front_mm", "force_error_n", "position_95_mm",
                                    "truth_within_position_95", "extent_95_mm", "truth_within_uncertainty", "gauss_newton_s", "lbfgs_s",
                                    "lbfgs_front_mm", "lbfgs_force_n"], "", "")]},
    "modbus": {
        "title": "Modbus", "area": "modbus", "code": ["firmware/modbus/server.h"],
        "text": "A client's waits over loopback: one read after the other with nothing else running; beside a client that sends the "
                "functions on which Modbus libraries sleep (hostile); a thousand reads in a second of a finsightd that measures, "
                "beside attacks; and during a soak.",
        "tabled": ["attack"],
        "notes": ["The median read is slowest on the idle machine: both processors sleep between request and answer, and waking "
                  "them takes longer than the answer. Beside anything that keeps them awake it is a tenth of a millisecond less."],
        "tables": [("modbus.attack", ["method", "reads", "p50_us", "p99_us", "worst_ms", "attacks_per_s", "heartbeat_per_s",
                                      "server_cpu"], "A lawful client beside each kind of attack (nobody: the client alone).", "")]},
    "page": {
        "title": "Commissioning page", "area": "page", "code": ["firmware/page/README.md"],
        "text": "What browsers that watch cost the frame loop: 99 % of the times of frames of 1280×720 pixels at 60 frames/s, watched less "
                "unwatched, in turns; the median of the rounds. Below zero: the cost is lost in the machine's own spread, which the "
                "rounds show."},
    "fingers": {
        "title": "Several fingers on one machine", "area": "fingers", "code": ["firmware/device/finger.h"],
        "text": "One, two and three fingers, each with a loop of its own, replay a session of 1280×720 pixels at 60 frames/s, tier newton; "
                "each finger, and the memory of the whole program.",
        "figures": False,
        "tables": [("fingers", ["method", "p50_ms", "p99_ms", "worst_ms", "frames", "dropped", "memory_mb"],
                    "By number of fingers, the slowest of them; a frame may take 16.7 ms.", ""),
                   ("fingers.each", ["fingers", "finger", "p50_ms", "p99_ms", "worst_ms", "frames", "dropped"], "Each finger.", "")]},
    "appliance": {
        "title": "Appliance", "area": "appliance", "code": ["boards/image/README.md"],
        "text": "From the last image test (<code>tests/system/boot --json</code>) of the image that the version names; its last digits "
                "are date and time. Instructions of the stages are medians of their own, so they need not add up to the frame's."},
}
