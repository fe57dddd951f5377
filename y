nice: ‘x/tm-sim’: No such file or directory
block-cut.yaml 
nice: ‘x/tm-sim’: No such file or directory
block-gravity.yaml 
nice: ‘x/tm-sim’: No such file or directory
block-press.yaml 
nice: ‘x/tm-sim’: No such file or directory
cylinder-fibre.yaml 
nice: ‘x/tm-sim’: No such file or directory
evaluate-cautery.yaml 
nice: ‘x/tm-sim’: No such file or directory
evaluate-cut.yaml 
nice: ‘x/tm-sim’: No such file or directory
evaluate-fibred.yaml 
nice: ‘x/tm-sim’: No such file or directory
evaluate-grasper.yaml 
nice: ‘x/tm-sim’: No such file or directory
evaluate-hybrid.yaml 
nice: ‘x/tm-sim’: No such file or directory
evaluate-isotropic.yaml 
nice: ‘x/tm-sim’: No such file or directory
evaluate-precomputed.yaml 
nice: ‘x/tm-sim’: No such file or directory
evaluate-two-cauteries.yaml 
nice: ‘x/tm-sim’: No such file or directory
evaluate-two-hands.yaml 
nice: ‘x/tm-sim’: No such file or directory
liver-cut.yaml 
nice: ‘x/tm-sim’: No such file or directory
liver-press.yaml 
