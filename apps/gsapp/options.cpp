// SPDX-License-Identifier: Apache-2.0
// `gsapp options`: prints the table of options, as YAML with the defaults or as the documentation page.
#include <iostream>
#include <memory>

#include "apps/gsapp/command.h"
#include "lib/core/foreign_options.h"
#include "lib/core/options.h"

namespace gs {

void add_options_command(CLI::App& app, Command& selected) {
    CLI::App* sub = app.add_subcommand("options", "Print all training options with their defaults as YAML");
    const auto markdown = std::make_shared<bool>(false);
    CLI::Option* page = sub->add_flag("--markdown", *markdown, "print docs/options.md instead");
    const auto coming_from = std::make_shared<bool>(false);
    sub->add_flag("--coming-from", *coming_from,
                  "print docs/coming-from.md instead: the options of other programs that are understood")
        ->excludes(page);
    sub->callback([markdown, coming_from, &selected] {
        selected = [markdown, coming_from] {
            std::cout << (*markdown      ? options_markdown()
                          : *coming_from ? coming_from_markdown()
                                         : options_to_yaml(TrainOptions{}));
        };
    });
}

}  // namespace gs
