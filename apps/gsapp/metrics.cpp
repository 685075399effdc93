// SPDX-License-Identifier: Apache-2.0
// gsapp metrics: compares two images, or scores runs under the name that 3DGS has for it.
#include "apps/gsapp/metrics.h"

#include <cstdio>
#include <memory>

#include "apps/gsapp/command.h"
#include "apps/gsapp/eval.h"
#include "apps/gsapp/printing.h"
#include "eval/metrics/compare_images.h"
#include "kernels/base/error.h"
#include "lib/core/json_text.h"

namespace gs {
namespace {

struct CompareArguments {
    std::string render, truth;
    std::string ssim_border, lpips_range = "symmetric";
    MetricArguments metrics{"all", ""};
    std::vector<std::string> runs;
    bool json = false;
};

void compare(const CompareArguments& arguments) {
    MetricOptions options = metric_options(arguments.metrics, parse_lpips_range(arguments.lpips_range));
    options.ssim_border = parse_ssim_border(arguments.ssim_border.empty() ? "valid" : arguments.ssim_border);
    const auto names = parse_metric_names(arguments.metrics.names);
    const std::vector<ImageScore> scores = compare_images(arguments.render, arguments.truth, names, options);
    std::fputs(arguments.json ? (json_text(scores_json(scores), 1) + "\n").c_str() : format_scores(scores).c_str(),
               stdout);
}

void run_metrics(const CompareArguments& arguments) {
    if (arguments.runs.empty()) {
        if (arguments.truth.empty()) throw UsageError("metrics: name two images, RENDER and TRUTH, or runs, -m RUN");
        return compare(arguments);
    }
    EvalArguments eval;
    eval.runs = arguments.runs;
    eval.ssim_border = arguments.ssim_border;
    eval.metrics = arguments.metrics;
    eval.json = arguments.json;
    run_eval(eval);
}

}  // namespace

void add_metric_options(CLI::App& command, MetricArguments& arguments) {
    command
        .add_option("--metrics", arguments.names,
                    "Any of psnr, ssim, lpips-vgg, lpips-alex, flip, dists, milo, with commas between; or all")
        ->capture_default_str()
        ->type_name("LIST");
    command
        .add_option("--metric-weights", arguments.weights,
                    "Folder of weights for lpips, dists and milo, from scripts/export_metric_weights.py (default: "
                    "$GSAPP_METRIC_WEIGHTS)")
        ->type_name("DIR");
    command
        .add_option_function<std::string>(
            "--device", [&arguments](const std::string& text) { arguments.device = choice_of<Device>(text); },
            "Where learned metrics are computed (default: auto), and runs rendered (default: as they were trained): "
            "auto, "
            "cpu or cuda")
        ->check(CLI::IsMember(words<Device>()));
}

MetricOptions metric_options(const MetricArguments& arguments, LpipsRange lpips_range) {
    MetricOptions options;
    options.lpips_range = lpips_range;
    options.weights = metric_weights_folder(arguments.weights);
    if (arguments.device) options.device = *arguments.device;
    return options;
}

void add_metrics_command(CLI::App& app, Command& selected) {
    auto arguments = std::make_shared<CompareArguments>();
    CLI::App* command = app.add_subcommand(
        "metrics",
        "Compare two images, as 8 bits and with alpha on black, by the metrics of eval; with -m RUN the same as eval");
    CLI::Option* runs = add_runs_option(*command, arguments->runs, "");
    command->add_option("render", arguments->render, "The image to judge")->type_name("RENDER")->excludes(runs);
    command->add_option("truth", arguments->truth, "The image it should equal")->type_name("TRUTH")->excludes(runs);
    add_metric_options(*command, arguments->metrics);
    command->add_option(
        "--ssim-border", arguments->ssim_border,
        "SSIM at the image border: valid, reflect or zero (3DGS) (default: valid; of runs as protocol paper has it)");
    command
        ->add_option("--lpips-range", arguments->lpips_range,
                     "What LPIPS is given: symmetric (mapped to [-1,1], torchmetrics with normalize=True) or unit "
                     "(left in [0,1], 3DGS)")
        ->capture_default_str()
        ->excludes(runs);
    command->add_flag("--json", arguments->json,
                      "Full numbers as JSON: scores (null = infinite), not_measured, protocol");
    add_quiet_flag(*command);
    command->callback([arguments, &selected] { selected = [arguments] { run_metrics(*arguments); }; });
}

}  // namespace gs
