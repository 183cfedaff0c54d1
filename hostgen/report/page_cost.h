// What browsers that watch the commissioning page cost the frame loop.
#pragma once

#include <filesystem>
#include <nlohmann/json_fwd.hpp>

namespace finsight::host {

/// Reads the times of every frame from the block in `folder`, unwatched and watched by `browsers` of them at
/// 127.0.0.1:`port` in turns of `seconds`, `rounds` times each; each browser listens to the events and asks for
/// pictures and shapes as the page's own code does. loop_cost_us: median over the rounds of the difference of the 99th
/// percentiles; dropped: frames lost while they watched. Throws InputError and std::system_error if there is no block,
/// std::runtime_error if the page does not answer.
nlohmann::json measure_page_cost(const std::filesystem::path& folder, int port, double seconds, int rounds,
                                 int browsers);

}  // namespace finsight::host
