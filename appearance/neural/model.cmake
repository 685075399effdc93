# SPDX-License-Identifier: Apache-2.0
gs_add_appearance(neural Neural)
gs_add_appearance(neural_1layer NeuralOneLayer)
gs_add_appearance(neural_3layers NeuralThreeLayers)
gs_add_appearance(neural_wide NeuralWide)
gs_add_appearance(neural_plain NeuralPlain)
