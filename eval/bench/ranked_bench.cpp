// SPDX-License-Identifier: Apache-2.0
// Runs steps on several views of a generated set, between two reports of all ranks, and writes the measurements as
// tables and JSON.
#include "eval/bench/ranked_bench.h"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "eval/bench/bench_cases.h"
#include "kernels/base/clock.h"
#include "lib/core/json_text.h"
#include "lib/core/version.h"
#include "lib/model/appearance_spec.h"
#include "lib/train/choose_backend.h"
#include "lib/train/group_backend.h"
#include "lib/train/step_composer.h"

namespace gs {
namespace {

/// Warm-up steps, in which memory is allocated and connections reach their full speed.
constexpr int kFirstSteps = 3;

using OrderedJson = nlohmann::ordered_json;

constexpr double kMega = 1e6;

/// Returns the share of its step time that a rank spent in exchanges.
double exchange_share(const RankReport& rank) {
    return rank.costs.seconds > 0 ? rank.costs.traffic.seconds / rank.costs.seconds : 0;
}

TextTable set_table(const std::vector<RankedBenchResult>& results) {
    TextTable table{.title = {},
                    .header = {"Gaussians", "ranks", "views a step", "views/s", "ms/step", "link GB/s",
                               "link latency us", "floor of exchanges ms", "of the step %"},
                    .num_labels = 0};
    for (const RankedBenchResult& r : results) {
        const bool alone = r.ranks.size() < 2;
        const auto of_link = [&](std::string text) { return TextCell{alone ? "-" : std::move(text)}; };
        table.lines.push_back({{fmt::format("{}", r.num_gaussians)},
                               {fmt::format("{}", r.ranks.size())},
                               {fmt::format("{}", r.views_per_step)},
                               {fmt::format("{:.2f}", r.views_per_second())},
                               {fmt::format("{:.2f}", 1e3 * r.step_seconds())},
                               of_link(fmt::format("{:.2f}", r.link.bytes_per_second / 1e9)),
                               of_link(fmt::format("{:.0f}", 1e6 * r.link.latency_seconds)),
                               of_link(fmt::format("{:.2f}", 1e3 * exchange_floor(r))),
                               of_link(fmt::format("{:.1f}", 100 * exchange_floor(r) / r.step_seconds()))});
    }
    return table;
}

TextTable rank_table(const std::vector<RankedBenchResult>& results) {
    TextTable table{.title = {},
                    .header = {"Gaussians", "rank of", "its Gaussians", "resident MB", "device MB", "sent MB/step",
                               "received MB/step", "messages/step", "exchanges/step", "in exchanges %", "CPU ms/step"},
                    .num_labels = 0};
    for (const RankedBenchResult& r : results)
        for (std::size_t k = 0; k < r.ranks.size(); ++k) {
            const RankReport& rank = r.ranks[k];
            const Traffic& traffic = rank.costs.traffic;
            table.lines.push_back(
                {{fmt::format("{}", r.num_gaussians)},
                 {fmt::format("{} of {}", k, r.ranks.size())},
                 {fmt::format("{}", rank.rows)},
                 {fmt::format("{:.1f}", double(rank.resident_bytes) / kMega)},
                 {rank.device_bytes > 0 ? fmt::format("{:.1f}", double(rank.device_bytes) / kMega) : "-"},
                 {fmt::format("{:.4f}", traffic.sent / r.steps / kMega)},
                 {fmt::format("{:.4f}", traffic.received / r.steps / kMega)},
                 {fmt::format("{:.1f}", double(traffic.messages) / r.steps)},
                 {fmt::format("{:.1f}", double(traffic.exchanges) / r.steps)},
                 {fmt::format("{:.1f}", 100 * exchange_share(rank))},
                 {fmt::format("{:.1f}", 1e3 * rank.costs.cpu_seconds / r.steps)}});
        }
    return table;
}

OrderedJson json_of_ranks(const RankedBenchResult& r) {
    OrderedJson json = {{"subject", r.subject},
                        {"device", r.device},
                        {"num_gaussians", r.num_gaussians},
                        {"width", r.width},
                        {"height", r.height},
                        {"num_ranks", r.ranks.size()},
                        {"views_per_step", r.views_per_step},
                        {"steps", r.steps},
                        {"seconds", r.seconds},
                        {"views_per_second", r.views_per_second()},
                        {"link",
                         {{"between_devices", r.link_name},
                          {"message_bytes", r.link.message_bytes},
                          {"bytes_per_second", r.link.bytes_per_second},
                          {"latency_seconds", r.link.latency_seconds},
                          {"device_latency_seconds", r.link.device_latency_seconds}}},
                        {"exchange_floor_seconds", exchange_floor(r)},
                        {"ranks", OrderedJson::array()}};
    for (const RankReport& rank : r.ranks) {
        const Traffic& traffic = rank.costs.traffic;
        json["ranks"].push_back({{"num_gaussians", rank.rows},
                                 {"resident_bytes", rank.resident_bytes},
                                 {"device_bytes", rank.device_bytes},
                                 {"seconds", rank.costs.seconds},
                                 {"cpu_seconds", rank.costs.cpu_seconds},
                                 {"exchange_seconds", traffic.seconds},
                                 {"splats_sent", rank.costs.splats_sent},
                                 {"bytes_sent", traffic.sent},
                                 {"bytes_received", traffic.received},
                                 {"messages", traffic.messages},
                                 {"exchanges", traffic.exchanges},
                                 {"device_exchanges", traffic.device_exchanges}});
    }
    return json;
}

}  // namespace

RankedBenchResult bench_ranks(RankGroup* group, const TrainOptions& options, std::int64_t count,
                              const BenchOptions& bench) {
    const AppearanceSpec appearance = appearance_spec(options);
    RankedBenchResult result;
    result.subject = fmt::format("generated set of {:.3g} M Gaussians, seed {}", double(count) / 1e6, options.seed);
    result.num_gaussians = count;
    result.steps = bench.repeat;
    result.views_per_step = views_of_step(options.batch, group);
    Gaussians model = generated_gaussians(count, options.seed, appearance);
    Scene scene;
    {
        const auto renders = make_backend(options.device, appearance, engine_options(options), group);
        renders->upload(model);
        scene = generated_scene(*renders, options.background.color);
    }
    result.width = scene.train[0].camera.width, result.height = scene.train[0].camera.height;
    std::vector<std::shared_ptr<const ViewImage>> images;
    std::vector<Image> photographs;
    for (const View& view : scene.train) {
        images.push_back(std::make_shared<const ViewImage>(view.load()));
        photographs.push_back(images.back()->color);
    }
    StepViews views{.per_step = result.views_per_step};
    put_targets(views.about_targets, photographs);
    const auto backend = make_backend(options.device, appearance, engine_options(options), group, views);
    result.device = backend->describe();
    backend->upload(model);
    model = {};  // so that rank 0 holds the same memory as in a training
    const StepComposer composer(options, appearance, scene, nullptr, kFrozenRates);
    std::int64_t iteration = 0;
    const auto step = [&] {
        std::vector<StepRequest> views;
        for (int k = 0; k < result.views_per_step; ++k, ++iteration) {
            const std::size_t view = std::size_t(iteration) % images.size();
            views.push_back(
                composer.compose({view, backend->needs_pixels(k) ? images[view] : nullptr, options.background.color},
                                 ScheduleMoment{iteration, double(iteration)}));
        }
        StepComposer::combine(views);
        backend->step_on(views);
    };
    for (int k = 0; k < kFirstSteps; ++k) step();
    backend->take_reports();
    const double start = seconds_now();
    for (int k = 0; k < result.steps; ++k) step();
    backend->synchronize();
    result.seconds = seconds_now() - start;
    result.ranks = backend->take_reports();
    result.link = backend->measure_connection();
    if (const DeviceLink* link = group ? group->communicator().link() : nullptr) result.link_name = link->name();
    return result;
}

double exchange_floor(const RankedBenchResult& result) {
    if (result.ranks.size() < 2) return 0;
    double most = 0;
    for (const RankReport& rank : result.ranks)
        most = std::max({most, rank.costs.traffic.sent, rank.costs.traffic.received});
    const Traffic& traffic = result.ranks[0].costs.traffic;
    const double of_devices = double(traffic.device_exchanges), of_hosts = double(traffic.exchanges) - of_devices;
    return (most / result.link.bytes_per_second + of_hosts * result.link.latency_seconds +
            of_devices * result.link.device_latency_seconds) /
           result.steps;
}

std::string format_ranked_bench(const std::vector<RankedBenchResult>& results, TableStyle style) {
    if (results.empty()) return "";
    const RankedBenchResult& first = results[0];
    const std::string link = first.link_name.empty() ? "" : ", connected by " + first.link_name;
    return fmt::format("{}{}; {} steps at {}x{}\n\n", first.device, link, first.steps, first.width, first.height) +
           table_text(set_table(results), style) + "\n" + table_text(rank_table(results), style) +
           "\nBytes are those that ranks exchanged, as counted where they were; waiting for slower ranks counts as "
           "exchange. The link was measured by exchanges of large messages and of 16 bytes among all ranks, "
           "of large ones on the way that splats take.\n";
}

std::string ranked_bench_json(const std::vector<RankedBenchResult>& results) {
    OrderedJson json = {{"program", version_text()}, {"results", OrderedJson::array()}};
    for (const RankedBenchResult& result : results) json["results"].push_back(json_of_ranks(result));
    return json_text(json, 1) + "\n";
}

}  // namespace gs
